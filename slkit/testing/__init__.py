"""Conformance suites: what every codec and every calibrator must do, slkit's own and a stranger's alike.

Call them from a test of your own; they raise AssertionError with a sentence and need no test framework.
"""

from slkit.testing._calibrator import check_calibrator
from slkit.testing._codec import check_codec

__all__ = ["check_calibrator", "check_codec"]
