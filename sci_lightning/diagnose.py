"""``python -m sci_lightning.diagnose``: where do captures and model disagree, and which effect is missing?"""

from sci_lightning.cli.commands.diagnose import main

if __name__ == "__main__":
    main()
