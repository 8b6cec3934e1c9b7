"""Many captures in one call, on a local Dask cluster of two workers.

    pip install 'slkit[dask]'
    python examples/07_batch.py FOLDER

FOLDER gets simulated captures and rig.json, and in clouds/ a cloud of each and batch.jsonl, which says what became of
them. One capture lacks a picture: it is recorded, and the others are scanned; then the picture turns up, and the second
call scans that capture only. The same with `slkit batch`, which needs no cluster:

    slkit batch 'FOLDER/captures/*' --rig FOLDER/rig.json -o FOLDER/clouds --resume
"""

import sys
from pathlib import Path

import slkit
from slkit import jobs
from slkit.simulation import paper_rig

SCENES = ("plane", "sphere", "step-wedge", "dumbbell", "free-form")


def main(folder: Path, rig: slkit.Rig | None = None) -> None:
    """Simulate a capture of each scene, lose a picture, scan them all, find the picture, scan what is left."""
    from distributed import LocalCluster

    rig = rig or paper_rig()
    slkit.write_rig(folder / "rig.json", rig)
    for seed, scene in enumerate(SCENES):
        slkit.simulate_scan(folder / "captures" / scene, rig, scene, ["gray"], {"step": 2}, seed=seed)
    picture = sorted((folder / "captures" / "sphere").glob("*.png"))[5]
    lost = picture.rename(folder / picture.name)

    # On a real cluster: `with jobs.cluster("tcp://HOST:8786") as pool`, and captures where all its machines reach them.
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        jobs.cluster(cluster.scheduler_address) as pool,
    ):
        for resume in (False, True):
            result = jobs.scan_all(
                f"{folder}/captures/*", jobs.Recipe(rig), str(folder / "clouds"), pool, resume=resume
            )
            print(f"{result.captures} captures: {result.scanned} scanned, {result.unchanged} unchanged", end="")
            print(f", {len(result.failures)} failed, {result.points} points")
            for record in result.failures:
                print(f"  {record.capture}: {record.error}")
            if not resume:
                lost.rename(picture)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python examples/07_batch.py FOLDER")
    main(Path(sys.argv[1]))
