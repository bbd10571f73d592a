"""``python -m sci_lightning.benchmark``: what decoding one measurement costs here, beside the paper's figures."""

from sci_lightning.cli.commands.benchmark import main

if __name__ == "__main__":
    main()
