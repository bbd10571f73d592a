"""``python -m sci_lightning.tables.relay``: give the next trainings of the relay a lease of this machine's GPU."""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("tables_relay")
