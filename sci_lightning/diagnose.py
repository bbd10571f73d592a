"""``python -m sci_lightning.diagnose``: where do captures and model disagree, and which effect is missing?"""

from sci_lightning.cli.start import start

if __name__ == "__main__":
    start("diagnose")
