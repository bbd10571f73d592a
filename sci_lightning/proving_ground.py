"""``python -m sci_lightning.proving_ground``: how often is a diagnosis right?"""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("proving_ground")
