"""The parser of the command line: short errors, and the options that every command has."""

from __future__ import annotations

import argparse
import difflib
import re
import sys
from typing import Any, NoReturn


class CommandParser(argparse.ArgumentParser):
    """argparse's, that says what is wrong in one line with the next step."""

    def __init__(self, *args: Any, **options: Any):
        options.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(*args, **options)
        # What looks like one is a value. argparse's own knows neither -1,0,0 nor -5e-3.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        """One line on stderr, exit code 2."""
        text = message[:1].upper() + message[1:].rstrip(".")
        hint = f"'{self.prog} --help' shows the usage."
        print(f"{self.prog}: error: {text}. {self._nearest(message)}{hint}", file=sys.stderr)
        raise SystemExit(2)

    def parse_args(self, *given: Any, **options: Any) -> Any:
        """As argparse's; what no command knows is told by the command that was called."""
        arguments, unknown = self.parse_known_args(*given, **options)
        if unknown:
            called = self
            for action in self._actions:
                if isinstance(action, argparse._SubParsersAction):
                    called = action.choices[getattr(arguments, action.dest)]
            called.error(f"unrecognized arguments: {' '.join(unknown)}")
        return arguments

    def _nearest(self, message: str) -> str:
        """Which option, command or choice was meant."""
        known = list(self._option_string_actions)
        for action in self._actions:
            known += [str(choice) for choice in action.choices or ()]
        wrong = re.search(r"invalid choice: '([^']*)'|unrecognized arguments: (\S+)", message)
        if wrong is None:
            return ""
        word = (wrong[1] or wrong[2]).partition("=")[0]
        near = difflib.get_close_matches(word, known, n=1)
        return f"Did you mean {near[0]}? " if near else ""


def add_common(parser: argparse.ArgumentParser) -> None:
    """Add what each command takes: --debug."""
    parser.add_argument(
        "--debug",
        action="store_true",
        default=argparse.SUPPRESS,
        help="show the traceback of an error",
    )
