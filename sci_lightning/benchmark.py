"""``python -m sci_lightning.benchmark``: what decoding one measurement costs here, beside the paper's figures."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("benchmark")
