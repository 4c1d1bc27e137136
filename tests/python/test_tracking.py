"""Walks, one photograph after the other."""

import copy
import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from scenes import DEMO, MESH, HlocScene

import raylift
from synthetic import some


@pytest.fixture(scope="module")
def hloc(tmp_path_factory: pytest.TempPathFactory) -> HlocScene:
    return HlocScene(tmp_path_factory.mktemp("tracking"))


@pytest.fixture(scope="module")
def localizer(hloc: HlocScene) -> raylift.Localizer:
    files = {"features": hloc.features, "matches": hloc.matches_file, "pairs": hloc.pairs}
    return raylift.Localizer(raylift.Scene(DEMO / "model", [MESH]), **files)


@pytest.fixture(scope="module")
def odometry(hloc: HlocScene) -> dict[str, raylift.Rigid3]:
    """The true motion in a frame of its own, by name."""
    world_from_odometry = raylift.Rigid3([0.5, 0.5, -0.5, 0.5], [3, -2, 1])
    return {name: hloc.truth[name].cam_from_world * world_from_odometry for name, _ in hloc.queries}


def test_tracker_is_localize_online(hloc: HlocScene, localizer: raylift.Localizer,
                                    odometry: dict[str, raylift.Rigid3], tmp_path: Path) -> None:
    raylift.write_poses(tmp_path / "odometry.txt", odometry)
    out = tmp_path / "out"
    raylift.localize(out, model=DEMO / "model", geometry=MESH, queries=hloc.query_list, features=hloc.features,
                     matches=hloc.matches_file, pairs=hloc.pairs, odometry=tmp_path / "odometry.txt", online=True)
    walked = {line["name"]: line for line in map(json.loads, open(out / "queries.jsonl"))}
    alone = localizer.localize_all(hloc.queries)
    tracker = raylift.Tracker(localizer)
    for time, name in enumerate(sorted(odometry)):
        tracked = tracker.add(alone[name], cam_from_odometry=odometry[name], time=time)
        assert tracked and tracked.role == walked[name]["walk"]["role"]
        pose = tracked.result.cam_from_world
        assert list(some(pose).qvec) + list(some(pose).tvec) == [
            *walked[name]["cam_from_world"]["qvec"], *walked[name]["cam_from_world"]["tvec"]]
        assert np.abs(some(pose).center - hloc.truth[name].cam_from_world.center).max() < 0.01
        in_odometry = some(tracked.world_from_odometry).inverse() * some(pose).inverse()
        assert np.abs(in_odometry.tvec - odometry[name].center).max() < 1e-9
        assert tracked.scale == 1 and not tracked.lost_before


def test_a_photograph_without_a_pose_gets_the_walks(hloc: HlocScene, localizer: raylift.Localizer,
                                                    odometry: dict[str, raylift.Rigid3]) -> None:
    tracker = raylift.Tracker(localizer, odometry_scale="known")
    names = sorted(odometry)
    alone = localizer.localize_all(hloc.queries)
    for time, name in enumerate(names[:-1]):
        tracker.add(alone[name], cam_from_odometry=odometry[name], time=time)
    last = names[-1]
    [camera] = [query.camera for query in hloc.queries if query.name == last]
    nothing = localizer.localize_matches(camera, np.empty((0, 2)), np.empty((0, 2)), [], name=last)
    assert not nothing
    tracked = tracker.add(nothing, cam_from_odometry=odometry[last], time=10)
    assert isinstance(tracked, raylift.TrackedPose)
    assert tracked.role == "rescued" and tracked.single_cam_from_world is None and tracked.single_confidence == 0
    assert np.abs(some(tracked.result.cam_from_world).center - hloc.truth[last].cam_from_world.center).max() < 0.05
    assert "rescued" in repr(tracked)
    for again in pickle.loads(pickle.dumps(tracked)), copy.copy(tracked):
        assert again == tracked and again is not tracked and repr(again) == repr(tracked)
        assert again.result == tracked.result and again.world_from_odometry == tracked.world_from_odometry
        assert (again.scale, again.lost_before, again.single_confidence) == (1, False, 0)
    assert tracked != raylift.Tracker(localizer).add(alone[names[0]], cam_from_odometry=odometry[names[0]], time=0)


def test_what_is_no_walk_is_refused(hloc: HlocScene, localizer: raylift.Localizer,
                                    odometry: dict[str, raylift.Rigid3]) -> None:
    name = hloc.queries[0][0]
    alone = localizer.localize_all(hloc.queries[:1])[name]
    tracker = raylift.Tracker(localizer)
    tracker.add(alone, cam_from_odometry=odometry[name], time=1)
    with pytest.raises(raylift.InputError, match="expected a time after 1 s, found 1 s"):
        tracker.add(alone, cam_from_odometry=odometry[name], time=1)
    with pytest.raises(raylift.InputError, match="expected a finite time, found nan"):
        raylift.Tracker(localizer).add(alone, cam_from_odometry=odometry[name], time=float("nan"))
    with pytest.raises(TypeError, match="belong to a photograph"):
        tracker.add(alone, hloc.queries[0][1], cam_from_odometry=odometry[name], time=2)
    with pytest.raises(raylift.OptionError, match="odometry_scale"):
        raylift.Tracker(localizer, odometry_scale="guessed")  # type: ignore[arg-type]
    with pytest.raises(raylift.OptionError, match="min_confidence"):
        raylift.Tracker(localizer, min_confidence=2)
