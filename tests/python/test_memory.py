"""Calls by the thousand leave nothing behind: neither Python's objects nor the library's memory."""

import gc
import tracemalloc
from typing import Any, Callable

import numpy as np
import pytest

import raylift
from synthetic import CAMERA, Problem, resident_kb

CALLS = 10000
SQUARE = raylift.Mesh([[-9, -9, 5], [9, -9, 5], [9, 9, 5], [-9, 9, 5]], [[0, 1, 2], [0, 2, 3]])


Call = Callable[[], object]


def estimate() -> Call:
    data = Problem(points=30, wrong=0)
    once: dict[str, Any] = dict(method="p3p", refinement="paper", min_iterations=1, max_iterations=1)

    def call() -> object:
        found = raylift.estimate_pose(CAMERA, data.points2d, data.points3d, **once)
        return found.inliers_2d3d, found.covariance, found.cam_from_world, found.noise

    return call


def lift() -> Call:
    lifter, pixels = raylift.Lifter(raylift.RayCaster(SQUARE)), np.full((30, 2), 100.0)
    return lambda: lifter.lift((CAMERA, np.eye(4)), pixels)


def render() -> Call:
    caster, camera = raylift.RayCaster(SQUARE), raylift.Camera("SIMPLE_PINHOLE", 16, 12, [16, 8, 6])
    products = ["depth", "normals", "mask"]
    return lambda: caster.render(camera, np.eye(4), products, threads=1)


def raises(error: type[Exception], call: Call) -> Call:
    def attempt() -> None:
        with pytest.raises(error):
            call()

    return attempt


def wrong_arrays() -> Call:
    data = Problem(points=30, wrong=0)
    return raises(raylift.InputError,
                  lambda: raylift.estimate_pose(CAMERA, data.points2d, data.points3d[1:]))


def wrong_options() -> Call:
    caster = raylift.RayCaster(SQUARE)
    return raises(raylift.OptionError, lambda: caster.render(CAMERA, np.eye(4), ["dept"]))


@pytest.mark.parametrize("prepare", [estimate, lift, render, wrong_arrays, wrong_options])
def test_no_memory_is_lost(prepare: Callable[[], Call]) -> None:
    call = prepare()
    # What grows once: caches, pools of threads, the allocators' own reserves.
    for _ in range(CALLS // 10):
        call()
    gc.collect()
    resident = resident_kb()
    for _ in range(CALLS):
        call()
    gc.collect()
    lost_kb = resident_kb() - resident
    # One pointer lost per call would be an allocation of 32 bytes, 312 kB in all; resident memory
    # itself comes and goes by some pages. An array lost per call is above 2 MB.
    assert lost_kb < 1024, f"{lost_kb} kB more are resident"

    traced = 0
    tracemalloc.start()
    try:
        for i in range(CALLS // 2):
            call()
            if i == 10:
                gc.collect()
                traced = tracemalloc.get_traced_memory()[0]
        gc.collect()
        lost = tracemalloc.get_traced_memory()[0] - traced
    finally:
        tracemalloc.stop()
    # The smallest object has 16 bytes. Python and numpy keep up to 30 kB to use again.
    assert lost < 16 * (CALLS // 2 - 11), f"{lost} bytes more are held by Python"
