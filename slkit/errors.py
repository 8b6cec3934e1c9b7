"""What can go wrong, as a small tree.

SlkitError                 a person's mistake: one sentence that says what is wrong, where, and what to do
├── InputError             a value, an array or a parameter is not what it must be
├── FileError              a file or folder is absent, unreadable, damaged or of the wrong kind
├── PluginError            a codec, calibrator, triangulator, scanner or exporter of that name is not installed
├── DecodeError            a set of frames cannot be decoded at all (never raised for single pixels)
└── CalibrationError       too little, or contradictory, evidence to calibrate from

The command line prints the sentence and exits with 2. Anything else that escapes is a fault of slkit.
"""

from typing import Any


class SlkitError(Exception):
    """A mistake that a person can mend, told in one sentence."""


class InputError(SlkitError):
    """A value, an array or a parameter is not what it must be."""


class FileError(SlkitError):
    """A file or a folder is absent, unreadable, damaged or of the wrong kind."""


class PluginError(SlkitError):
    """No plug-in of that name is installed."""


class DecodeError(SlkitError):
    """A set of frames cannot be decoded at all."""


class CalibrationError(SlkitError):
    """There is too little evidence, or contradictory evidence, to calibrate from.

    findings: the mistakes (`slkit.data.Finding`) that the pictures show, empty where they show none.
    """

    def __init__(self, message: str, findings: tuple[Any, ...] = ()) -> None:
        super().__init__(message)
        self.findings = findings
