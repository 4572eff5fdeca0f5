"""Exit codes of the command line; wrong usage is argparse's 2."""

SUCCESS = 0
ERROR = 1
NO_ANSWER = 3
INTERRUPTED = 130
