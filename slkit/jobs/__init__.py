"""Many captures in one call: on the cores of this machine, on a cluster, or on any `concurrent.futures` executor.

Nothing here schedules: an executor does. Captures and clouds may lie wherever fsspec reaches.
"""

from slkit.jobs._batch import BatchResult, Interrupted, scan_all
from slkit.jobs._captures import find_captures
from slkit.jobs._manifest import MANIFEST, Record
from slkit.jobs._places import read_rig
from slkit.jobs._pools import Pool, cluster, local_pool
from slkit.jobs._scanning import Recipe

__all__ = [
    "MANIFEST",
    "BatchResult",
    "Interrupted",
    "Pool",
    "Recipe",
    "Record",
    "cluster",
    "find_captures",
    "local_pool",
    "read_rig",
    "scan_all",
]
