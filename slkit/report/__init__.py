"""Numbers and pictures that say how good a scan or a calibration is."""
