"""The error of a command that is used wrongly."""


class UsageError(ValueError):
    """An argument is wrong in a way that argparse cannot see: the command ends with status 2 and this one line."""
