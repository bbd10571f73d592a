"""The one exception that is meant for the person at the keyboard."""


class BadInput(ValueError):
    """Something the user gave cannot be used.

    The message is one line: what is wrong, where, and what would be right. Commands print it
    without a traceback and exit with status 2; a notebook sees an ordinary ``ValueError``.
    """
