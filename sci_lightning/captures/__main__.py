"""``python -m sci_lightning.captures``: plan a session, pack and register what was recorded, see what is in a file."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("captures")
