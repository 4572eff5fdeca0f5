"""Exit codes of the command line; wrong usage is argparse's 2."""

SUCCESS = 0
ERROR = 1
WRONG_USAGE = 2
NO_ANSWER = 3
INTERRUPTED = 130

MEANINGS = {
    SUCCESS: "done",
    ERROR: "an error, in one line on stderr",
    WRONG_USAGE: "wrong usage",
    NO_ANSWER: "no answer: no grasp was found, or none holds",
    INTERRUPTED: "interrupted (Ctrl-C); what was found until then is printed and written",
}
