"""`mtu`: the entry point. All is imported within, where an interrupt is waited for already."""

from __future__ import annotations

import sys

EXIT_INTERRUPTED = 130


def main() -> None:
    """Runs the command line; an interrupt ends it without a word, from its imports on."""
    try:
        from mtu_cli.cli.process import run

        run()
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)
