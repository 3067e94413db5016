"""Ctrl-C at a chosen line of Python that the main thread runs."""

import sys


def struck_at(step, work):
    """Run `work`, struck at its step-th line or return: True; False where it swallowed that; None: it is over before."""
    passed = 0

    def trace(frame, event, _):
        nonlocal passed
        passed += event in ("line", "return")
        if passed == step:
            sys.settrace(None)
            raise KeyboardInterrupt
        return trace

    sys.settrace(trace)
    try:
        work()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(None)
    return None if passed < step else False
