"""The CUDA loops against the processor's: on a device where there is one, and on numba's simulator everywhere."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from slkit.device import on_cuda, on_device, why_no_cuda
from slkit.errors import InputError

COMPARISON = Path(__file__).parents[1] / "device_comparison.py"


def compared(**environment: str) -> str:
    command = [sys.executable, str(COMPARISON)]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | environment, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_cuda_gives_what_the_processor_gives():
    if why := why_no_cuda():
        pytest.skip(f"no CUDA device: {why}")
    assert compared().count("the same") == 12


def test_the_simulator_gives_what_the_processor_gives():
    assert compared(NUMBA_ENABLE_CUDASIM="1").count("the same") == 12


def test_the_choice_ends_with_its_block():
    assert not on_cuda()
    with on_device("cpu"):
        assert not on_cuda()
    with pytest.raises(InputError, match="device must be one of cpu, cuda, not 'gpu'"), on_device("gpu"):
        pass


def test_without_a_device_one_sentence_says_why(slkit, tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("slkit.device.why_no_cuda", lambda: "the driver is too old")
    arguments = ("scan", tmp_path / "none", "--rig", tmp_path / "rig.json", "-o", tmp_path / "x.ply", "--device")
    outcome = slkit(*arguments, "cuda")
    assert (outcome.code, outcome.out) == (2, "") and outcome.err.count("\n") == 1
    assert "no CUDA device to run on: the driver is too old" in outcome.err
    outcome = slkit(*arguments, "gpu")
    assert outcome.code == 2 and "device must be one of cpu, cuda, not 'gpu'" in outcome.err
    assert list(tmp_path.iterdir()) == []
