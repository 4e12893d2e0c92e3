"""What a message to the user must not look like."""

import re

LONGEST = 2000
"""Characters of a line; a message may list what is known, but not a file's content."""
_PROGRAM = re.compile(
    r"Traceback|<class |object at 0x|pydantic|numpy|np\.[a-z]|pandas|Exception\b|NoneType"
    r"|(?:Value|Type|Key|Index|Attribute|Recursion|Unicode|Assertion|Overflow)Error|Errno|sys\."
)
"""Words of the program in place of words about the file."""
_WARNING = re.compile(r"[A-Z]\w*Warning:")


def unclean(message: str) -> str | None:
    """What is wrong with a message of one problem a line, or None."""
    if not message.strip():
        return "the message is empty"
    for line in message.split("\n"):
        if not line.strip():
            return f"an empty line: {message!r}"
        if not line.isprintable():
            return f"signs that a terminal obeys: {line!r}"
        if len(line) > LONGEST:
            return f"a line of {len(line)} characters: {line[:200]!r}"
        if found := _PROGRAM.search(line) or _WARNING.search(line):
            return f"words of the program, {found[0]!r}: {line!r}"
    return None


def warned(text: str) -> str | None:
    """A warning of a library on standard error, or None."""
    found = _WARNING.search(text)
    return None if found is None else f"a warning of the program: {text[found.start() :][:300]!r}"
