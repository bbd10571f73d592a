"""``python -m sci_lightning.demo``: a first result in a minute, snapshots and the frames decoded from them."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("demo")
