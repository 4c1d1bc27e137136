import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import raylift
from raylift import _results
from synthetic import CAMERA, Problem, some
from test_rendering import CORNERS, FACES, FRONT, PINHOLE

IMAGE = raylift.PosedImage("front.jpg", PINHOLE, FRONT)
PIXELS = np.array([[32, 24], [47, 24], [1, 1], [33.5, 20.25]])


@pytest.fixture(scope="module")
def mesh() -> raylift.Mesh:
    return raylift.Mesh(CORNERS, FACES)


def expect_face(lifted: _results.LiftedPixels) -> None:
    """The face z = -1, 3 before the camera; the third pixel sees none."""
    points = lifted["points"]
    assert points[0] == pytest.approx([0, 0, -1], abs=1e-5)
    assert points[1] == pytest.approx([0.75, 0, -1], abs=1e-5)
    assert points[3] == pytest.approx([1.5 * 3 / 60, -3.75 * 3 / 60, -1], abs=1e-5)
    assert np.isnan(points[2]).all() and np.isnan(lifted["depth"][2])
    assert lifted["depth"][[0, 1, 3]] == pytest.approx(3, abs=1e-5)
    assert lifted["normals"][0] == pytest.approx([0, 0, -1], abs=1e-5)
    assert lifted["incidence_deg"][1] == pytest.approx(np.degrees(np.arctan(15 / 60)), abs=1e-2)
    assert lifted["back_face"].dtype == bool


def test_lifting_from_meshes_of_all_kinds(mesh: raylift.Mesh, tmp_path: Path) -> None:
    caster = raylift.RayCaster(mesh)
    for geometry in mesh, caster, raylift.Geometry(mesh), raylift.Geometry(caster):
        expect_face(raylift.Lifter(geometry).lift(IMAGE, PIXELS))
    expect_face(raylift.Geometry(caster).lift((PINHOLE, FRONT), PIXELS))
    assert "mesh" in raylift.Geometry(caster).description
    with pytest.raises(raylift.OptionError, match="geometry"):
        raylift.Geometry("voxels:a")
    with pytest.raises(raylift.InputError, match="geometry: expected a Mesh"):
        raylift.Geometry(3)  # type: ignore[arg-type]
    with pytest.raises(raylift.OptionError, match="at least one"):
        raylift.Lifter()


def test_lifting_from_depth_in_memory(mesh: raylift.Mesh) -> None:
    maps = raylift.RayCaster(mesh).render(PINHOLE, FRONT, ["depth", "distance"])
    depth = raylift.DepthMaps.from_arrays({"front.jpg": maps["depth"], "other.jpg": 3}, [IMAGE])
    expect_face(depth.lift(IMAGE, PIXELS))
    along = raylift.DepthMaps.from_arrays({"front.jpg": maps["distance"]}, [IMAGE], kind="ray")
    expect_face(along.lift(IMAGE, PIXELS))
    halved = raylift.DepthMaps.from_arrays({"front.jpg": maps["depth"] / 2}, [IMAGE], scale=2)
    expect_face(halved.lift(IMAGE, PIXELS))
    loaded = some(depth.load(IMAGE))
    assert np.array_equal(loaded, maps["depth"]) and not loaded.flags.owndata and not loaded.flags.writeable
    assert depth.load(raylift.PosedImage("other.jpg", PINHOLE, FRONT)) is None
    with pytest.raises(raylift.InputError, match="maps: none is of a reference"):
        raylift.DepthMaps.from_arrays({}, [IMAGE])
    with pytest.raises(raylift.OptionError, match="kind = up: expected z"):
        raylift.DepthMaps.from_arrays({"front.jpg": maps["depth"]}, [IMAGE], kind="up")  # type: ignore[arg-type]


def test_lifting_many_pixels_is_lifting_each(mesh: raylift.Mesh) -> None:
    depth = raylift.RayCaster(mesh).render(PINHOLE, FRONT)["depth"]
    depth[:, 32:] = 0
    lifter = raylift.Lifter(raylift.DepthMaps.from_arrays({"front.jpg": depth}, [IMAGE]), mesh)
    pixels = np.random.default_rng(3).uniform((0, 0), (64, 48), (140000, 2))
    lifted = lifter.lift(IMAGE, pixels)
    assert set(lifted["source"]) == {-1, 0, 1}
    for start in (0, 65500, 131000, 139900):
        part = lifter.lift(IMAGE, pixels[start:start + 100])
        for key, values in part.items():
            np.testing.assert_array_equal(lifted[key][start:start + 100], values)  # type: ignore[literal-required]


def test_lifting_from_depth_in_files(mesh: raylift.Mesh, tmp_path: Path) -> None:
    depth = raylift.RayCaster(mesh).render(PINHOLE, FRONT)["depth"]
    np.save(tmp_path / "front.npy", (1000 * depth).round().astype(np.uint16))
    maps = raylift.DepthMaps(tmp_path, [IMAGE], unit="mm")
    expect_face(maps.lift(IMAGE, PIXELS))
    expect_face(raylift.Geometry(f"depth:{tmp_path},unit=mm", references=[IMAGE]).lift(IMAGE, PIXELS))
    assert "uint16" in maps.interpretation and maps.warnings == []
    first, second = some(maps.load(IMAGE)), some(maps.load(IMAGE))
    assert first == pytest.approx(depth, abs=1e-3)
    assert first.__array_interface__["data"] == second.__array_interface__["data"]
    assert not first.flags.writeable
    with pytest.raises(raylift.OptionError, match="sort"):
        raylift.DepthMaps(tmp_path, [IMAGE], sort="z")
    with pytest.raises(raylift.InputError):
        raylift.DepthMaps(tmp_path / "missing", [IMAGE])


def test_lifting_from_a_model(tmp_path: Path) -> None:
    model = raylift.ColmapModel()
    model.add_camera(1, PINHOLE)
    for i in (1, 2):
        model.add_image(i, f"{i}.jpg", 1, FRONT, [[32, 24], [40, 24]], [7, -1])
    model.add_point3d(7, [0, 0, -1], [[1, 0], [2, 0]], error_px=0.5)
    model.write(tmp_path)
    points = raylift.SfmPoints(tmp_path, model.posed_images)
    lifted = points.lift(model.posed_images[0], [[32, 24], [40, 24]])
    assert lifted["points"][0] == pytest.approx([0, 0, -1]) and np.isnan(lifted["points"][1]).all()
    two = raylift.Lifter(points, raylift.Mesh(CORNERS, FACES)).lift(model.posed_images[0],
                                                                    [[32, 24], [40, 24], [0, 0]])
    assert two["source"].tolist() == [0, 1, -1]


def test_pixels_outside_of_the_image_show_nothing(mesh: raylift.Mesh) -> None:
    wall = raylift.Mesh([[-99, -99, 5], [99, -99, 5], [0, 99, 5]], [[0, 1, 2]])
    pixels = np.array([[-1, 24], [65, 49], [-1.1, 24], [32, 49.1], [np.nan, 24]])
    for geometry in raylift.Geometry(wall), raylift.Lifter(mesh, wall):
        lifted = geometry.lift(IMAGE, pixels)
        assert np.isfinite(lifted["points"]).all(axis=1).tolist() == [True, True, False, False, False]
    assert raylift.Lifter(mesh, wall).lift(IMAGE, pixels)["source"].tolist() == [1, 1, -1, -1, -1]


def test_geometry_pickles_copies_compares_and_shows_itself(mesh: raylift.Mesh, tmp_path: Path) -> None:
    caster = raylift.RayCaster(mesh, build="low")
    depth = caster.render(PINHOLE, FRONT)["depth"]
    np.save(tmp_path / "front.npy", depth)
    model = raylift.ColmapModel()
    model.add_camera(1, PINHOLE)
    model.add_image(1, "front.jpg", 1, FRONT, PIXELS)
    for i in range(2):
        model.add_point3d(i, [0, 0, -1 + i], [[1, i]])
    model.write(tmp_path / "model")
    in_memory: dict[str, Any] = dict(interpolation="nearest", max_jump=0.1)
    several: list[Any] = [raylift.Geometry(mesh), raylift.Geometry(f"depth:{tmp_path}", references=[IMAGE]),
               raylift.Geometry("sfm", model=tmp_path / "model", references=[IMAGE]),
               raylift.DepthMaps(tmp_path, [IMAGE], scale=2),
               raylift.DepthMaps.from_arrays({"front.jpg": depth}, [IMAGE], **in_memory),
               raylift.SfmPoints(tmp_path / "model", [IMAGE]), raylift.Lifter(caster, mesh, geometry_mode="all")]
    for one in several:
        again = pickle.loads(pickle.dumps(one))
        for other in again, copy.copy(one), copy.deepcopy(one):
            assert type(other) is type(one) and repr(other) == repr(one) and other is not one
            for before, after in zip(one.lift(IMAGE, PIXELS).values(), other.lift(IMAGE, PIXELS).values()):
                np.testing.assert_array_equal(before, after)
        assert isinstance(one, raylift.Lifter) or one == again and hash(one) == hash(again)
    assert several[0] != several[1] != several[3] and several[4] != several[3] and several[0] != 5
    assert raylift.DepthMaps.from_arrays({"front.jpg": depth + 1}, [IMAGE], **in_memory) != several[4]
    assert repr(several[-1]) == "<raylift.Lifter mesh from memory, mesh from memory>"
    assert len({caster, pickle.loads(pickle.dumps(caster))}) == 1
    assert pickle.loads(pickle.dumps(caster)) == caster == raylift.RayCaster(mesh, build="low") != raylift.RayCaster(mesh)

    for maps in several[3], several[4]:
        assert isinstance(maps, raylift.DepthMaps)
        assert some(maps._repr_png_()).startswith(b"\x89PNG")
    (tmp_path / "front.npy").unlink()
    assert raylift.DepthMaps.from_arrays({"front.jpg": 0 * depth}, [IMAGE])._repr_png_() is None
    cloud = raylift.Geometry(raylift.RayCaster.of_points(np.random.default_rng(0).normal(0, 1, (40, 3))))
    assert cloud == cloud and cloud != several[0]
    with pytest.raises(raylift.InputError, match="geometry: cloud from memory has no state"):
        pickle.dumps(cloud)


def wall_problem() -> tuple[Problem, raylift.PoseProblem, NDArray[np.float64], raylift.Mesh]:
    """Pairs of a query and three references before a wall, the plane z = 5."""
    wall = raylift.Mesh([[-9, -9, 5], [9, -9, 5], [9, 9, 5], [-9, 9, 5]], [[0, 2, 1], [0, 3, 2]])
    data = Problem(noise_px=0, wrong=0)
    points = data.points3d * (5 / data.points3d[:, 2:])
    query = CAMERA.project(data.truth.transform(points))
    reference = [CAMERA.project(r.cam_from_world.transform(points)) for r in data.references]
    problem = raylift.PoseProblem(CAMERA, references=data.references, query2d=np.vstack([query] * 3),
                                  reference2d=np.vstack(reference),
                                  reference_index=np.repeat(np.arange(3), len(points)))
    return data, problem, points, wall


def test_lifted_matches_give_the_pose() -> None:
    data, problem, points, wall = wall_problem()
    lifted = raylift.Lifter(wall).lift_matches(problem)
    assert len(problem.points3d) == 0 and len(lifted.points3d) == 3 * len(points)
    assert lifted.points3d == pytest.approx(np.vstack([points] * 3), abs=1e-5)
    assert (lifted.point_references == problem.reference_index).all()
    estimate = raylift.estimate_pose(CAMERA, lifted.points2d, lifted.points3d)
    data.expect_near(estimate, 0.01, 0.001)
    # By depth of any scale: lifted matches know their references.
    data.expect_near(raylift.estimate_all([lifted], method="d3p1")[0], 0.05, 0.005)


def test_filter_and_candidates() -> None:
    _, problem, points, wall = wall_problem()
    lifted = raylift.Lifter(wall).lift_matches(problem)
    moved = lifted.points3d.copy()
    moved[:20] += [0, 0, 2]  # of the first reference
    wrong = raylift.PoseProblem(
        CAMERA, lifted.points2d, moved, references=lifted.references, query2d=lifted.query2d,
        reference2d=lifted.reference2d, reference_index=lifted.reference_index,
        point_references=lifted.point_references, point_matches=lifted.point_matches)
    filtered, keep, counts = raylift.filter_points(wrong, "fixed")
    assert not keep[:20].any() and keep[20:].all() and counts["consistent"] == keep.sum()
    assert filtered.points3d.tolist() == moved[keep].tolist()
    _, keep, _ = raylift.filter_points(wrong, "off")
    assert keep.all()
    _, keep, _ = raylift.filter_points(wrong, "fixed", filter_reprojection_px=1e4)
    assert keep.all()
    raylift.filter_points(wrong)  # auto
    merged = raylift.merge_candidates(wrong)
    assert merged.points3d == pytest.approx(points, abs=1e-4)
    triangulated = raylift.merge_candidates(problem, candidates="triangulate")
    assert len(triangulated.points3d) == len(points)
    assert triangulated.points3d == pytest.approx(points, abs=1e-4)
    assert len(raylift.merge_candidates(wrong, candidates="keep").points3d) == len(moved)
    with pytest.raises(raylift.OptionError, match="filter = some"):
        raylift.filter_points(problem, "some")
    with pytest.raises(raylift.OptionError, match="filter_min_views = 0"):
        raylift.filter_points(problem, "fixed", filter_min_views=0)


@pytest.mark.parametrize("width, height, values, message", [
    (48, 64, b"", "map of a.jpg: expected 48 x 64 numbers, found 0"),
    (2, 2, bytes(12), "map of a.jpg: expected 2 x 2 numbers, found 3"),
    (-1, -1, bytes(4), "map of a.jpg: expected -1 x -1 numbers, found 1"), (0, 5, b"", "expected 0 x 5 numbers"),
    (1, 1, bytes(5), "state: expected numbers of 4 bytes each, found 5 bytes"),
])
def test_states_of_maps_that_do_not_fit_are_refused(width: int, height: int, values: bytes, message: str) -> None:
    maps = raylift.DepthMaps.__new__(raylift.DepthMaps)
    with pytest.raises(raylift.InputError, match=message):
        maps.__setstate__(([("a.jpg", width, height, values)], "edge", [IMAGE], 0.1))
