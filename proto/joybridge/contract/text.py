"""Text from elsewhere: what comes over the wire, or from a game, before it reaches a log, a status or a terminal."""

__all__ = ["printable"]


def printable(text: str) -> str:
    """Return the text with every character escaped that is not printable, as Python writes it in a string.

    Otherwise it could move the cursor, or write lines that seem to be somebody else's.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
