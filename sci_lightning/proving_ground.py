"""``python -m sci_lightning.proving_ground``: how often is a diagnosis right?"""

from sci_lightning.cli.commands.proving_ground import main

if __name__ == "__main__":
    main()
