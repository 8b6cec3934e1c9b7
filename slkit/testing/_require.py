"""How a conformance suite says that something is wrong."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from slkit.errors import SlkitError


def require(condition: Any, sentence: str) -> None:
    """Errors: AssertionError with `sentence` unless `condition` holds."""
    if not condition:
        raise AssertionError(sentence)


def require_refusal(action: Callable[[], Any], what: str, mention: str = "") -> None:
    """Errors: AssertionError unless `action` raises an SlkitError whose sentence contains `mention`."""
    try:
        action()
    except SlkitError as error:
        require(mention in str(error), f"{what} must raise an SlkitError that names {mention!r}; it says: {error}")
    except Exception as error:
        raise AssertionError(f"{what} must raise an SlkitError, not {type(error).__name__}: {error}") from error
    else:
        raise AssertionError(f"{what} must raise an SlkitError; nothing was raised")
