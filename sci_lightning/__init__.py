"""Design, train and trust a video snapshot compressive imaging camera."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("sci-lightning")
except PackageNotFoundError:  # running from a checkout that was never installed
    __version__ = "0+unknown"
