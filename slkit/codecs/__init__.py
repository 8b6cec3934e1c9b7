"""Codecs: from frames to correspondences, one method a file; reached by name through `slkit.registry`."""
