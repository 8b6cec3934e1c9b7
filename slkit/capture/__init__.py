"""Scanners: what takes a picture of every pattern."""

from slkit.capture.folder import FolderScanner

__all__ = ["FolderScanner"]
