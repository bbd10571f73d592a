"""Hand-made ``metrics.json`` files, as the tests of the tables have them."""

from tests.studies.tables.conftest import made

__all__ = ["made"]
