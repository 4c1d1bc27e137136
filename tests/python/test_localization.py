import copy
import inspect
import json
import os
import pickle
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raylift
from scenes import DEMO, MESH, HlocScene, truth
from synthetic import CAMERA, angle_deg, some

PHOTOGRAPHS = ["query/query_02.jpg", "query/query_05.jpg"]


@pytest.fixture(scope="module")
def localizer(tmp_path_factory: pytest.TempPathFactory) -> raylift.Localizer:
    scene = raylift.Scene(DEMO / "model", [MESH], images=DEMO / "images", every=2)
    return raylift.Localizer(scene, max_features=2048, cache=tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def hloc(tmp_path_factory: pytest.TempPathFactory) -> HlocScene:
    return HlocScene(tmp_path_factory.mktemp("hloc"))


def cameras() -> dict[str, raylift.Camera]:
    return {query.name: query.camera for query in raylift.read_queries(DEMO / "queries.txt")}


def expect_near(query: raylift.LocalizedQuery, name: str, units: float = 0.1) -> None:
    assert query, query
    assert np.linalg.norm(some(query.cam_from_world).center - truth()[name].cam_from_world.center) < units
    assert query.verdict == "localized" and query.confidence > 0.95 and query.reason == ""


def test_scene() -> None:
    scene = raylift.Scene(DEMO / "model", [MESH], images=DEMO / "images", every=3, every_offset=1)
    whole = raylift.Scene.read(DEMO / "scene.toml")
    assert [r.name for r in scene.references] == [r.name for r in whole.references][1::3]
    assert "scene.obj" in whole.geometry[0].description and whole.warnings == []
    assert len(whole.mesh.mesh.triangles) > 1000
    assert raylift.Scene(DEMO / "model").mesh is None
    mine = raylift.Scene.of(scene.references, [whole.mesh, whole.geometry[0], MESH])
    assert len(mine.geometry) == 3 and len(mine.references) == len(scene.references)
    assert "references" in repr(mine)
    with pytest.raises(raylift.OptionError, match="every = 0"):
        raylift.Scene(DEMO / "model", every=0)
    with pytest.raises(raylift.OptionError, match="model_poses = up"):
        raylift.Scene(DEMO / "model", model_poses="up")
    with pytest.raises(raylift.InputError, match="depth"):
        raylift.Scene.read(DEMO / "scene.toml", geometry=["depth"])


def test_photographs_in_memory_and_in_files(localizer: raylift.Localizer) -> None:
    for name in PHOTOGRAPHS:
        camera = cameras()[name]
        photograph = raylift.read_image(DEMO / "images" / name)
        query = localizer.localize(photograph, camera, name=name)
        expect_near(query, name)
        assert query.name == name and len(query.problem.references) == 10
        assert query.counts["retrieved"] == 10 and query.counts["points"] > 50
        assert query.counts["inliers_2d3d"] == query.estimate.num_inliers_2d3d
        assert some(query.estimate.covariance).shape == (6, 6)
        of_file = localizer.localize(DEMO / "images" / name, camera, name=name)
        mirrored = localizer.localize(photograph[:, ::-1][:, ::-1], camera, name=name)
        for other in of_file, mirrored:
            assert some(other.cam_from_world).matrix.tolist() == some(query.cam_from_world).matrix.tolist()


def test_features_of_ones_own(localizer: raylift.Localizer) -> None:
    name = PHOTOGRAPHS[0]
    features = raylift.extract_features(raylift.read_image(DEMO / "images" / name), max_features=2048)
    assert features["descriptors"].shape == (len(features["keypoints"]), 128)
    assert np.linalg.norm(features["descriptors"], axis=1) == pytest.approx(1, abs=1e-2)
    query = localizer.localize(features, cameras()[name], name=name)
    expect_near(query, name)

    # Of the references, too: none of their photographs is read.
    scene = raylift.Scene(DEMO / "model", [MESH], every=4)
    of_references = {
        r.name: raylift.extract_features(raylift.read_image(DEMO / "images" / r.name), max_features=1000)
        for r in scene.references}
    own = raylift.Localizer(scene, reference_features=of_references)
    expect_near(own.localize(features, cameras()[name]), name)


@pytest.mark.parametrize("query, camera, message", [
    (np.zeros((10, 10), np.uint8), CAMERA, "10"),
    (np.zeros((480, 640), float), CAMERA, "image: expected a uint8 array"),
    (np.zeros((480, 640, 4), np.uint8), CAMERA, r"found \(480, 640, 4\)"),
    (None, CAMERA, "query: expected a photograph or features"),
    ({"keypoints": np.zeros((3, 2))}, CAMERA, "features: expected keypoints"),
    ({"keypoints": np.zeros((3, 2)), "descriptors": np.zeros((2, 128))}, CAMERA, r"shape \(3, D\)"),
    ("missing.jpg", CAMERA, "missing.jpg"),
])
def test_wrong_queries_are_input_errors(
        localizer: raylift.Localizer, query: Any, camera: raylift.Camera, message: str) -> None:
    with pytest.raises(raylift.InputError, match=message):
        localizer.localize(query, camera)


@pytest.mark.parametrize("options, message", [
    (dict(top_k=0), "top_k = 0"),
    (dict(features="a.h5"), "features, matches and pairs go together"),
    (dict(first_pixel=2.0), "first_pixel = 2"),
    (dict(candidates="some"), "candidates = some: expected keep"),
    (dict(filter_min_views=0, filter="fixed"), "filter_min_views = 0"),
    (dict(method="p5p"), "method = p5p"),
    (dict(geometry="mesh:a"), "geometry: there is no such option"),
    (dict(matcher_name="a", cache="b"), "matcher_name needs cache and matcher"),
    (dict(matcher_name="a", matcher=print), "matcher_name needs cache and matcher"),
    (dict(matcher_name="a", cache="b", matcher=print, extractor=print), "extractor_name"),
])
def test_wrong_options_of_the_localizer(options: dict[str, Any], message: str) -> None:
    with pytest.raises(raylift.OptionError, match=message):
        raylift.Localizer(raylift.Scene(DEMO / "model"), **options)


def test_options_are_those_of_the_program_with_its_defaults() -> None:
    text = subprocess.run([os.environ["RAYLIFT"], "localize", "--help"], check=True, text=True,
                          capture_output=True).stdout
    # "--name TEXT=default" or, by later versions of CLI11, "--name TEXT [default]".
    of_program = dict(re.findall(r"^  --([a-z0-9-]+)(?: [A-Z]+(?:=| \[)([^\s\]]+))?", text, flags=re.MULTILINE))
    documented = inspect.getdoc(raylift.Localizer.__init__)
    options = re.findall(r"\b([a-z_]+)=\"?([\w.]+)\"?", some(documented).split("\nreference_features:")[0])
    assert len(options) > 12
    for name, default in options:
        assert of_program[name.replace("_", "-")] == default.rstrip("."), name
    scene = raylift.Scene(DEMO / "model")
    typed = {"filter": str, "candidates": str, "geometry_mode": str, "filter_min_views": int, "top_k": int,
             "max_features": int, "filter_reprojection_px": float, "align_depth": str, "rerender": int}
    raylift.Localizer(scene, **{name: typed.get(name, float)(default.rstrip(".")) for name, default in options})


def test_a_blank_photograph_has_no_pose(localizer: raylift.Localizer) -> None:
    query = localizer.localize(np.zeros((480, 640), np.uint8), CAMERA)
    assert isinstance(query, raylift.LocalizedQuery)
    assert not query and query.cam_from_world is None and query.verdict == "failed"
    assert query.reason and query.confidence == 0 and query.reason in repr(query)


def test_matches_of_ones_own(hloc: HlocScene) -> None:
    name, camera = hloc.queries[0]
    arrays = {reference.name: np.hstack([
        np.array(hloc.keypoints[name])[hloc.matches[name, reference.name][0]],
        hloc.keypoints[reference.name][hloc.matches[name, reference.name][1]]])
        for reference in hloc.references}
    localizer = raylift.Localizer(hloc.scene)
    matches = raylift.hloc.matches_from(arrays)
    query = localizer.localize_matches(camera, **matches)
    hloc.expect_near(name, some(query.cam_from_world))
    assert query.counts["matched"] == sum(map(len, arrays.values()))
    # Corners instead of centers for the first pixel's place: half a pixel beside it.
    shifted = raylift.hloc.matches_from({k: v + 0.5 for k, v in arrays.items()}, first_pixel=0.5)
    assert shifted["query2d"] == pytest.approx(matches["query2d"])
    one = raylift.hloc.matches_from(arrays[hloc.references[0].name], reference=hloc.references[0].name)
    assert set(one["reference_names"]) == {hloc.references[0].name}
    # Pixels in one cell are one keypoint.
    by_cell = raylift.hloc.matches_from(
        {"a": [[1.2, 1.3, 0.0, 0.0], [5.0, 5.0, 0.0, 0.0]], "b": [[1.4, 1.1, 0, 0]]}, cell_px=2)
    cells = some(by_cell.get("query_keypoints"))
    assert cells[0] == cells[2] != cells[1]
    assert len(raylift.hloc.matches_from({})["query2d"]) == 0
    with pytest.raises(raylift.InputError, match=r"'a': expected an array of shape \(N, 4\)"):
        raylift.hloc.matches_from({"a": np.zeros((3, 3))})
    with pytest.raises(raylift.InputError, match="no reference nowhere.jpg"):
        localizer.localize_matches(camera, [[1, 2]], [[1, 2]], ["nowhere.jpg"])
    with pytest.raises(raylift.InputError, match="expected as many, found 1, 1 and 0"):
        localizer.localize_matches(camera, [[1, 2]], [[1, 2]], [])


def test_many_queries_with_hlocs_files(hloc: HlocScene) -> None:
    localizer = raylift.Localizer(hloc.scene, features=hloc.features, matches=hloc.matches_file,
                                  pairs=hloc.pairs)
    told = []
    found = localizer.localize_all(hloc.queries, threads=2, progress=lambda *a: told.append(a))
    assert list(found) == [name for name, _ in hloc.queries]
    assert told[-1] == (len(hloc.queries), len(hloc.queries), "queries")
    for name, query in found.items():
        hloc.expect_near(name, some(query.cam_from_world))


def test_many_queries_with_colmaps_database(hloc: HlocScene, tmp_path: Path) -> None:
    database = tmp_path / "database.db"
    hloc.write_database(database)
    found = raylift.Localizer(hloc.scene, matches=database).localize_all(hloc.queries)
    for name, query in found.items():
        hloc.expect_near(name, some(query.cam_from_world))
    raylift.localize(tmp_path / "out", model=DEMO / "model", queries=hloc.query_list, matches=database,
                     geometry=MESH)
    raylift.write_poses(tmp_path / "poses.txt",
                        {name: some(query.cam_from_world) for name, query in found.items()})
    assert (tmp_path / "poses.txt").read_bytes() == (tmp_path / "out/poses.txt").read_bytes()

    # With a list of pairs, what it lists alone.
    name, reference = hloc.queries[0][0], hloc.references[3].name
    (tmp_path / "pairs.txt").write_text(f"{name} {reference}\n")
    listed = raylift.Localizer(hloc.scene, matches=str(database), pairs=tmp_path / "pairs.txt")
    problem = listed.localize_all(hloc.queries[:1])[name].problem
    assert [image.name for image in problem.references] == [reference]
    with pytest.raises(raylift.OptionError, match="COLMAP's database"):
        raylift.Localizer(hloc.scene, features=hloc.features, matches=database)


def test_references_localized_by_each_other(tmp_path: Path) -> None:
    every: dict[str, Any] = dict(every=4)
    scene = raylift.Scene(DEMO / "model", [MESH], images=DEMO / "images", **every)
    told = []
    found = raylift.Localizer(scene, max_features=1000, top_k=5, cache=tmp_path / "cache").leave_one_out(
        progress=lambda *a: told.append(a))
    assert list(found) == [r.name for r in scene.references] and told[-1] == (6, 6, "queries")
    for reference in scene.references:
        query = found[reference.name]
        assert reference.name not in [other.name for other in query.problem.references]
        error = np.linalg.norm(some(query.cam_from_world).center - reference.cam_from_world.center)
        assert error < 0.1, reference.name
    raylift.localize(tmp_path / "out", model=DEMO / "model", images=DEMO / "images", geometry=MESH,
                     leave_one_out=True, max_features=1000, top_k=5, cache=tmp_path / "cache", **every)
    raylift.write_poses(tmp_path / "poses.txt",
                        {name: some(query.cam_from_world) for name, query in found.items()})
    assert (tmp_path / "poses.txt").read_bytes() == (tmp_path / "out/poses.txt").read_bytes()


def test_a_query_has_one_pose_whoever_asks(tmp_path: Path) -> None:
    # Monocular depth: each map has a scale of its own.
    caster = raylift.Scene(DEMO / "model", [MESH]).mesh
    references = raylift.Scene(DEMO / "model", every=3).references
    rng = np.random.default_rng(0)
    for reference in references:
        depth = caster.render(reference.camera, reference.cam_from_world)["depth"]
        file = (tmp_path / "depth" / reference.name).with_suffix(".npy")
        file.parent.mkdir(parents=True, exist_ok=True)
        np.save(file, (depth * rng.uniform(1.2, 2)).astype(np.float32))

    spec = f"depth:{tmp_path / 'depth'}"
    scene = raylift.Scene(DEMO / "model", [spec], images=DEMO / "images", every=3)
    options: dict[str, Any] = dict(max_features=1500, cache=tmp_path / "cache")
    queries = [(name, cameras()[name]) for name in PHOTOGRAPHS]
    many = raylift.Localizer(scene, **options).localize_all(queries)
    localizer = raylift.Localizer(scene, **options)
    calibration = tmp_path / "calibration.json"
    localizer.write_calibration(calibration)
    known = raylift.Localizer(scene, scene_calibration=calibration, **options)
    again = known.localize_all(queries[::-1])
    raylift.write_queries(tmp_path / "queries.txt", queries)
    subprocess.run([os.environ["RAYLIFT"], "localize", "--model", DEMO / "model", "--images", DEMO / "images",
                    "--geometry", spec, "--every", "3", "--queries", tmp_path / "queries.txt",
                    "--max-features", "1500", "--cache", tmp_path / "cache", "--out", tmp_path / "out", "--quiet"],
                   check=True)
    assert calibration.read_bytes() == (tmp_path / "out/scene_calibration.json").read_bytes()
    of_program = raylift.read_poses(tmp_path / "out/poses.txt")
    problems = [many[name].problem for name, _ in queries]
    for i, estimate in enumerate(raylift.estimate_all(problems)):
        file = tmp_path / "problem.json"
        problems[i].write(file)
        by_file = raylift._core.estimate(raylift.PoseProblem.read(file), scene_calibration=calibration)
        copied = raylift._core.estimate(pickle.loads(pickle.dumps(problems[i])))
        for again_estimated in (estimate, by_file, copied):
            assert again_estimated.cam_from_world == many[queries[i][0]].estimate.cam_from_world
    for name, camera in queries:
        pose = some(many[name].cam_from_world).matrix.tolist()
        assert some(again[name].cam_from_world).matrix.tolist() == pose
        for other in localizer, known:
            alone = other.localize(DEMO / "images" / name, camera, name=name)
            assert some(alone.cam_from_world).matrix.tolist() == pose
        assert of_program[name].matrix == pytest.approx(some(many[name].cam_from_world).matrix, abs=1e-12)


def test_queries_with_what_is_known_beforehand(localizer: raylift.Localizer,
                                               tmp_path: Path) -> None:
    name = PHOTOGRAPHS[0]
    camera = cameras()[name]
    (tmp_path / "list.txt").write_text(f"{name} {camera} focal_sigma 0.002\n")
    [query] = raylift.read_queries(tmp_path / "list.txt")
    assert tuple(query) == (name, camera) and query[0] == query.name and query.focal_sigma == 0.002
    raylift.write_queries(tmp_path / "again.txt", [query])
    assert (tmp_path / "again.txt").read_text() == (tmp_path / "list.txt").read_text()

    whole = raylift.Query(name, camera, position_prior=([1, 2, 3], 4), gravity_prior=([0, 1, 0], [0, 0, -1], 2),
                          focal_sigma=0.1, focal_range=1.5)
    assert pickle.loads(pickle.dumps(whole)) == whole != query and len({whole, query}) == 2

    exact = localizer.localize_all([(name, camera)])[name]
    for uncertain in (localizer.localize_all([query])[name],
                      localizer.localize(DEMO / "images" / name, camera, name=name, focal_sigma=0.002)):
        expect_near(uncertain, name)
        assert uncertain.estimate.position_sigma > 1.05 * exact.estimate.position_sigma
    center = truth()[name].cam_from_world.center
    known = localizer.localize_all([raylift.Query(name, camera, position_prior=(center, 1e-4))])[name]
    assert np.linalg.norm(some(known.cam_from_world).center - center) < 1e-3
    found = localizer.localize(DEMO / "images" / name, raylift.Camera("SIMPLE_RADIAL", 640, 480,
                                                                      [400, 323.1, 236.4, -0.11]),
                               name=name, focal_range=1.5)
    assert some(found.estimate.refined_camera).params[0] == pytest.approx(camera.params[0], rel=0.03)


@pytest.mark.parametrize("priors, message", [
    (dict(focal_sigma=2), "focal_sigma: expected a share"),
    (dict(focal_range=0.5), "focal_range: expected a factor"),
    (dict(position_prior=([0, 0, 0], -1)), "position_prior, sigma: expected at least 0"),
    (dict(gravity_prior=([0, 0, 0], [0, 0, 1], 1)), "down_in_cam: expected a direction"),
    (dict(gravity_prior=([0, 0, 1], [0, 0, 1], float("nan"))), "sigma_deg: expected at least 0"),
    (dict(position_prior=([0, np.nan, 0], 1)), "position_prior: expected finite numbers"),
    (dict(heading_prior=([1, 0, 0], [0, 0, 1], [0, 0, -1], 1)), "heading_prior, down_in_world: expected another"),
    (dict(heading_prior=([1, 0, 0], [0, 0, 0], [0, 0, -1], 1)), "right_in_world: expected a direction"),
    (dict(orientation_prior=(np.eye(4), 1)), "orientation_prior, rotation: expected .* found 16 numbers"),
    (dict(orientation_prior=([1, 0, 0, 0], -1)), "orientation_prior, sigma_deg: expected at least 0"),
    (dict(range_prior=(0, 1)), "range_prior: expected a positive range"),
    (dict(range_prior=(float("inf"), 1)), "range_prior: expected a positive range"),
])
def test_wrong_priors_are_input_errors(localizer: raylift.Localizer, priors: dict[str, Any],
                                       message: str) -> None:
    with pytest.raises(raylift.InputError, match=message):
        raylift.Query("a.jpg", CAMERA, **priors)
    with pytest.raises(raylift.InputError, match=message):
        localizer.localize(np.zeros((480, 640), np.uint8), CAMERA, **priors)


def test_what_is_no_query(localizer: raylift.Localizer) -> None:
    several: list[Any] = ["a.jpg", ("a.jpg",), 5]
    for wrong in several:
        with pytest.raises(raylift.InputError, match="query: expected a raylift.Query or a pair"):
            localizer.localize_all([wrong])


def test_a_photograph_of_an_unknown_camera(localizer: raylift.Localizer, tmp_path: Path) -> None:
    name = PHOTOGRAPHS[0]
    file = DEMO / "images" / name
    (tmp_path / "names.txt").write_text(name + "\n")
    [listed] = raylift.read_queries(tmp_path / "names.txt", images=DEMO / "images")
    found = [localizer.localize(file, name=name), localizer.localize(raylift.read_image(file), name=name),
             localizer.localize_all([listed])[name]]
    for query in found:
        expect_near(query, name, 0.15)
        assert query.problem.camera == listed.camera and listed.focal_range > 1
        assert some(query.estimate.refined_camera).params[0] == pytest.approx(cameras()[name].params[0], rel=0.1)
    with pytest.raises(raylift.InputError, match="camera: expected that of the features"):
        localizer.localize(raylift.extract_features(raylift.read_image(file)))


def test_poses_are_sharpened_by_rendering(tmp_path: Path) -> None:
    scene = raylift.Scene(DEMO / "model", [MESH], images=DEMO / "images", every=3)
    options: dict[str, Any] = dict(max_features=1500, cache=tmp_path)
    name = PHOTOGRAPHS[0]
    camera = cameras()[name]
    plain = raylift.Localizer(scene, **options).localize_all([(name, camera)])[name]
    localizer = raylift.Localizer(scene, rerender=1, align_depth="off", **options)
    for sharp in (localizer.localize_all([(name, camera)])[name],
                  localizer.localize(DEMO / "images" / name, camera, name=name)):
        expect_near(sharp, name)
        assert len(sharp.problem.points3d) > len(plain.problem.points3d)
    with pytest.raises(raylift.OptionError, match="rerender = 1: needs a mesh or splats"):
        raylift.Localizer(raylift.Scene(DEMO / "model"), rerender=1)


def test_photographs_of_a_rig_are_localized_together(localizer: raylift.Localizer,
                                                     tmp_path: Path) -> None:
    names = PHOTOGRAPHS[:2]
    poses = [truth()[name].cam_from_world for name in names]
    second_from_first = poses[1] * poses[0].inverse()
    prefixes = [name[:-len(Path(name).suffix)] for name in names]
    links = []
    for folder, name in zip(("left", "right"), names):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "1.jpg").symlink_to(DEMO / "images" / name)
        links.append(f"{folder}/1.jpg")
    (tmp_path / "rigs.json").write_text(json.dumps([{"cameras": [
        {"image_prefix": "left/", "ref_sensor": True},
        {"image_prefix": "right/", "cam_from_rig_rotation": second_from_first.qvec.tolist(),
         "cam_from_rig_translation": second_from_first.tvec.tolist()}]}]))
    raylift.write_queries(tmp_path / "list.txt", [(link, cameras()[name]) for link, name in zip(links, names)])
    queries = raylift.read_queries(tmp_path / "list.txt", rigs=tmp_path / "rigs.json")
    assert some(queries[0].rig)[:2] == (some(queries[1].rig)[0], 0) and some(queries[1].rig)[1:] == (2, second_from_first)
    assert [raylift.Query(*query, rig=query.rig) for query in queries] == queries
    assert pickle.loads(pickle.dumps(queries)) == queries != raylift.read_queries(tmp_path / "list.txt")
    scene = raylift.Scene(DEMO / "model", [MESH], images=DEMO / "images")
    found = raylift.Localizer(scene, max_features=1500, query_images=tmp_path).localize_all(queries)
    between = some(found[links[1]].cam_from_world) * some(found[links[0]].cam_from_world).inverse()
    assert between.matrix == pytest.approx(second_from_first.matrix, abs=1e-9)
    assert np.linalg.norm(some(found[links[0]].cam_from_world).center - poses[0].center) < 0.05


def test_matches_outside_of_their_images_are_left_out(hloc: HlocScene) -> None:
    name, camera = hloc.queries[0]
    reference = hloc.references[0]
    of_query, of_reference = hloc.matches[name, reference.name]
    query = np.array(hloc.keypoints[name])[of_query] + 0.5
    pixels = np.asarray(hloc.keypoints[reference.name])[of_reference] + 0.5
    count = len(query)
    rows: Any = (np.vstack([query, query[:2], query[:1]]),
                 np.vstack([pixels, pixels[:1] + [camera.width, 0], pixels[:1] - 999, pixels[:1]]),
                 [reference.name] * (count + 3))
    rows[0][-1] = -1, camera.height + 1  # rounding may move a pixel so far
    localizer = raylift.Localizer(hloc.scene)
    found = localizer.localize_matches(camera, *rows, query_keypoints=np.arange(count + 3))
    inside = [*range(count), count + 2]
    assert found.problem.query2d.tolist() == rows[0][inside].tolist()
    assert found.problem.reference2d.tolist() == rows[1][inside].tolist()
    assert found.problem.query_keypoints.tolist() == inside
    message = rf"^query2d and reference2d: {count} of {count} matches lie outside of query \({camera.width} x"
    for query_px, reference_px in ((2 * query + 999, pixels), (query, pixels * np.nan)):
        with pytest.raises(raylift.InputError, match=message):
            localizer.localize_matches(camera, query_px, reference_px, [reference.name] * count)


def test_features_of_a_resized_photograph_are_refused() -> None:
    scene = raylift.Scene.of([raylift.PosedImage("a.jpg", CAMERA, raylift.Rigid3())])
    descriptors = np.eye(4, 8, dtype=np.float32)
    pixels = np.array([[641.5, 3], [642, 3], [5, 5], [6, 6]])
    many, of_many = np.tile(pixels * [1, 99], (3, 1)), np.eye(12, dtype=np.float32)

    def localizer(keypoints: Any, of: Any = descriptors) -> raylift.Localizer:
        return raylift.Localizer(scene, reference_features={"a.jpg": {"keypoints": keypoints, "descriptors": of}})

    localizer(pixels)  # most lie inside
    localizer(many[:9], of_many[:9])  # few tell nothing
    for wrong, of in (many, of_many), (np.full((4, 2), np.nan), descriptors):
        message = rf"features, keypoints: {len(wrong)} of {len(wrong)} lie outside of the image \(640 x 480"
        with pytest.raises(raylift.InputError, match=message):
            localizer(wrong, of)
    with pytest.raises(raylift.InputError, match="features, descriptors: expected finite numbers"):
        localizer(pixels, np.full((4, 8), np.inf))


def test_all_that_is_known_of_a_query_in_memory(localizer: raylift.Localizer, tmp_path: Path) -> None:
    name = PHOTOGRAPHS[0]
    camera, pose = cameras()[name], truth()[name].cam_from_world
    known: dict[str, Any] = dict(
        position_prior=(pose.center, 0.5), gravity_prior=([0, 1, 0], [0, 0, -1], 2),
        heading_prior=([1, 0, 0], [0, -1, 0], [0, 0, -1], 3), orientation_prior=(pose.rotation, 4),
        range_prior=(2.5, 0.1), focal_sigma=0.1, focal_range=1.5, rig=("1", 2, pose))
    query = raylift.Query(name, camera, **known)
    assert query.position_prior == (pose.center.tolist(), [0.5] * 3)
    assert query.gravity_prior == ([0, 1, 0], [0, 0, -1], 2)
    assert query.heading_prior == ([1, 0, 0], [0, -1, 0], [0, 0, -1], 3)
    quaternion, sigma = some(query.orientation_prior)
    assert quaternion == pytest.approx(pose.qvec.tolist(), abs=1e-12) and sigma == 4
    assert query.range_prior == (2.5, 0.1) and query.rig == ("1", 2, pose)
    arguments = {key: getattr(query, key) for key in known}
    again = raylift.Query(name, camera, **arguments)
    assert again == query == pickle.loads(pickle.dumps(query)) == copy.copy(query)
    plain = raylift.Query(name, camera)
    for key in known:
        assert getattr(plain, key) == (1 if key == "focal_range" else None)
        assert raylift.Query(name, camera, **{key: arguments[key]}) != plain

    # The same as of the program's files.
    (tmp_path / "list.txt").write_text(f"{name} {camera}\n")
    qvec = " ".join(map(repr, pose.qvec.tolist()))
    (tmp_path / "priors.txt").write_text(
        f"{name} heading 90 3\n{name} orientation {qvec} 4\n{name} range 2.5 0.1\n{name} focal_range 1.5\n")
    [read] = raylift.read_queries(tmp_path / "list.txt", priors=tmp_path / "priors.txt")
    assert some(read.heading_prior)[1] == pytest.approx([0, -1, 0], abs=1e-12)
    assert read.range_prior == query.range_prior and read.focal_range == query.focal_range
    assert some(read.orientation_prior)[0] == pose.qvec.tolist()

    right = pose.rotation.T @ [1, 0, 0]

    def heading_error_deg(found: raylift.LocalizedQuery) -> float:
        x, y, _ = some(found.cam_from_world).rotation.T @ [1, 0, 0]
        return abs(float(np.degrees(np.arctan2(y, x) - np.arctan2(right[1], right[0]))))

    photograph = DEMO / "images" / name
    free = localizer.localize(photograph, camera, name=name)
    turned = localizer.localize(photograph, camera, name=name, orientation_prior=(pose.rotation, 0.01))
    assert angle_deg(some(turned.cam_from_world), pose) < 0.5 * angle_deg(some(free.cam_from_world), pose)
    headed = localizer.localize(photograph, camera, name=name, heading_prior=(
        [1, 0, 0], right * [1, 1, 0], [0, 0, -1], 0.01))
    assert heading_error_deg(headed) < 0.5 * heading_error_deg(free)


def test_a_query_of_a_photograph_alone(tmp_path: Path) -> None:
    name = PHOTOGRAPHS[0]
    (tmp_path / "names.txt").write_text(name + "\n")
    [listed] = raylift.read_queries(tmp_path / "names.txt", images=DEMO / "images")
    query = raylift.Query(name, images=DEMO / "images")
    assert query == listed and query.focal_range > 1
    assert raylift.Query(name, images=DEMO / "images", focal_range=1.1).focal_range == 1.1
    for camera, images in (None, None), (CAMERA, DEMO / "images"):
        with pytest.raises(raylift.InputError, match="camera: expected it, or images"):
            raylift.Query(name, camera, images=images)
    with pytest.raises(raylift.InputError, match="missing.jpg"):
        raylift.Query("missing.jpg", images=DEMO / "images")


def test_references_are_retrieved_in_each_way(tmp_path: Path) -> None:
    scene = raylift.Scene(DEMO / "model", [MESH], images=DEMO / "images", every=3)
    options: dict[str, Any] = dict(max_features=1000, top_k=3, max_angle_deg=90, cache=tmp_path / "cache")
    queries = [raylift.Query(name, cameras()[name]) for name in PHOTOGRAPHS]
    poses = {name: truth()[name].cam_from_world for name in PHOTOGRAPHS}
    raylift.write_poses(tmp_path / "poses.txt", poses)
    ways: list[dict[str, Any]] = [
        dict(retrieval="pose", prior_poses=poses), dict(retrieval="pose", prior_poses=tmp_path / "poses.txt"),
        dict(retrieval="pose", prior_poses=poses, view_range=(1, 3)), dict(retrieval="overlap", prior_poses=poses)]
    names = []
    for way in ways:
        found = raylift.Localizer(scene, **way, **options).localize_all(queries)
        names.append([[r.name for r in found[name].problem.references] for name in PHOTOGRAPHS])
    pairs = raylift.retrieve(tmp_path / "pairs.txt", model=DEMO / "model", every=3, queries=DEMO / "queries.txt",
                             retrieval="pose", prior_poses=DEMO / "ground_truth", top_k=3, max_angle_deg=90)
    assert names[0] == names[1] == [pairs[name] for name in PHOTOGRAPHS]
    assert all(1 <= len(of_query) <= 3 for way in names for of_query in way) and names[0] != names[2] != names[3]

    by_pose = raylift.Localizer(scene, retrieval="pose", **options)
    alone = by_pose.leave_one_out()
    assert all(len(query.problem.references) <= 3 for query in alone.values())
    with pytest.raises(raylift.OptionError, match=r"retrieval = pose: needs prior_poses, but for leave_one_out\(\)"):
        by_pose.localize_all(queries)
    with pytest.raises(raylift.OptionError, match=r"retrieval = pose: is for localize_all\(\)"):
        by_pose.localize(DEMO / "images" / PHOTOGRAPHS[0])


@pytest.mark.parametrize("options, message", [
    (dict(retrieval="best"), "retrieval = best: expected vlad"),
    (dict(retrieval="global"), "retrieval global needs global_features"),
    (dict(prior_poses={}), "prior_poses goes with retrieval pose or overlap"),
    (dict(view_range=(1, 2)), "view_range goes with retrieval pose"),
    (dict(retrieval="pose", view_range=(2, 1)), "view_range = 2,1: expected NEAR,FAR"),
    (dict(view_range=5), r"view_range = 5: expected \(near, far\)"),
    (dict(max_angle_deg=0, retrieval="pose"), "max_angle_deg = 0"),
    (dict(max_angle_deg=181), "max_angle_deg = 181: must be above 0 and at most 180"),
    (dict(retrieval="overlap", prior_poses={}), "retrieval overlap needs geometry"),
    (dict(retrieval="vlad", matches="a", features="b", pairs="c"), "retrieval goes without files of matches"),
])
def test_wrong_options_of_retrieval(options: dict[str, Any], message: str) -> None:
    with pytest.raises(raylift.OptionError, match=message):
        raylift.Localizer(raylift.Scene(DEMO / "model"), **options)


def test_queries_that_become_references(hloc: HlocScene, tmp_path: Path) -> None:
    raylift.localize(tmp_path / "out", model=DEMO / "model", geometry=MESH, images=DEMO / "images", every=4,
                     queries=hloc.query_list, top_k=4, max_features=1500, continuous=True,
                     write_problems=tmp_path / "problems")
    problems = [raylift.PoseProblem.read(file) for file in (tmp_path / "problems").rglob("*.json")]
    assert sorted(problem.name for problem in problems) == sorted(query.name for query in hloc.queries)
    references = {reference.name for problem in problems for reference in problem.references}
    assert "query/query_02.jpg" in references
    hloc.expect_near("query/query_02.jpg", raylift.read_poses(tmp_path / "out/poses.txt")["query/query_02.jpg"], 0.1)


def test_localizers_and_scenes_pickle_copy_and_show_themselves(hloc: HlocScene, tmp_path: Path) -> None:
    files: dict[str, Any] = dict(features=hloc.features, matches=hloc.matches_file, pairs=hloc.pairs)
    localizer = raylift.Localizer(hloc.scene, method="p3p", **files)
    assert repr(localizer) == f"<raylift.Localizer in {len(hloc.scene.references)} references, method p3p>"
    again = pickle.loads(pickle.dumps(localizer))
    name, camera = hloc.queries[0]
    found = [one.localize_all([(name, camera)])[name] for one in (localizer, again)]
    assert some(found[0].cam_from_world) == some(found[1].cam_from_world)

    picture = found[0]._repr_png_()
    assert some(picture).startswith(b"\x89PNG") and "data:image/jpeg" in found[0]._repr_html_()
    assert pickle.loads(pickle.dumps(found[0]))._repr_png_() is None
    assert "data:image" not in pickle.loads(pickle.dumps(found[0]))._repr_html_()

    scene = raylift.Scene(DEMO / "model", [MESH], images=DEMO / "images", every=3)
    mixed = raylift.Scene.of(scene.references, [some(scene.mesh).mesh, MESH, raylift.Geometry(MESH)])
    for one in scene, mixed:
        for other in pickle.loads(pickle.dumps(one)), copy.copy(one), copy.deepcopy(one):
            assert other == one and hash(other) == hash(one) and other is not one and repr(other) == repr(one)
            assert [g.description for g in other.geometry] == [g.description for g in one.geometry]
            pixels = [[300, 200]]
            for before, after in zip(one.geometry, other.geometry):
                assert np.array_equal(before.lift(one.references[0], pixels)["points"],
                                      after.lift(one.references[0], pixels)["points"])
    assert scene != mixed and scene != raylift.Scene(DEMO / "model", [MESH], images=DEMO / "images", every=2)
    with pytest.raises(raylift.InputError, match="scene: its model was in memory"):
        pickle.dumps(raylift.Scene(raylift.ColmapModel.read(DEMO / "model")))


def test_a_reference_whose_few_matches_lie_outside_is_left_alone(hloc: HlocScene) -> None:
    name, camera = hloc.queries[0]
    first, second = hloc.references[:2]
    of_query, of_reference = hloc.matches[name, first.name]
    query = np.array(hloc.keypoints[name])[of_query] + 0.5
    pixels = np.asarray(hloc.keypoints[first.name])[of_reference] + 0.5
    rows: Any = (np.vstack([query, query[:1]]), np.vstack([pixels, [[camera.width + 2, 5]]]),
                 [first.name] * len(query) + [second.name])
    localizer = raylift.Localizer(hloc.scene)
    found = localizer.localize_matches(camera, *rows)
    assert found.problem.query2d.tolist() == query.tolist()
    alone = localizer.localize_matches(camera, *(row[-1:] for row in rows))
    assert not alone and len(alone.problem.query2d) == 0


def test_a_localizer_pickles_what_it_was_made_of() -> None:
    scene = raylift.Scene.of([raylift.PosedImage("a.jpg", CAMERA, raylift.Rigid3())])
    features: dict[str, Any] = {"keypoints": np.array([[5.0, 6]]), "descriptors": np.eye(1, 8, dtype=np.float32)}
    of_references, poses = {"a.jpg": features}, {"b.jpg": raylift.Rigid3()}
    localizer = raylift.Localizer(scene, reference_features=of_references, retrieval="pose", prior_poses=poses)
    before = pickle.dumps(localizer)
    features["keypoints"] = None
    of_references.clear()
    poses["b.jpg"] = raylift.Rigid3([1, 0, 0, 0], [1, 2, 3])
    assert pickle.dumps(localizer) == before
    pickle.loads(before)


def test_scenes_keep_how_their_geometry_was_opened(tmp_path: Path) -> None:
    depth = raylift.RayCaster(raylift.Mesh([[-9, -9, 4], [9, -9, 4], [9, 9, 4], [-9, 9, 4]], [[0, 2, 1], [0, 3, 2]])
                              ).render(CAMERA, raylift.Rigid3(), ["distance"])["distance"]
    np.save(tmp_path / "a.npy", (depth / 2).astype(np.float32))
    reference = raylift.PosedImage("a.jpg", CAMERA, raylift.Rigid3())
    texts: list[Any] = [f"depth:{tmp_path},kind=ray,scale=2", f"{MESH},far=3"]
    scene = raylift.Scene.of([reference], texts)
    again = raylift.Scene.of(scene.references, scene.geometry)
    pixels = [[100, 80], [320, 240]]
    assert scene.geometry[0].lift(reference, pixels)["depth"] == pytest.approx(4, abs=1e-3)
    for other in again, pickle.loads(pickle.dumps(again)), pickle.loads(pickle.dumps(scene)):
        for one, of_other in zip(scene.geometry, other.geometry):
            assert of_other == one == pickle.loads(pickle.dumps(one)) and len({one, of_other}) == 1
            np.testing.assert_array_equal(one.lift(reference, pixels)["points"],
                                          of_other.lift(reference, pixels)["points"])
    assert scene.geometry[1] == raylift.Geometry(texts[1])
    assert scene.geometry[0] == raylift.Geometry(texts[0], references=[reference])
    assert scene.geometry[0] != raylift.Geometry(f"depth:{tmp_path},kind=ray", references=[reference])
    assert again != raylift.Scene.of([reference], raylift.Scene.of([reference], [f"depth:{tmp_path}", texts[1]]).geometry)


def test_the_points_of_another_model_stay_those_of_it(tmp_path: Path) -> None:
    for name, z in ("one", 2), ("other", 7):
        model = raylift.ColmapModel()
        model.add_camera(1, CAMERA)
        for i in range(1, 5):
            model.add_image(i, f"{i}.jpg", 1, raylift.Rigid3(), [[320, 240]], [5])
        model.add_point3d(5, [0, 0, z], [[i, 0] for i in range(1, 5)])
        model.write(tmp_path / name)
    images = raylift.ColmapModel.read(tmp_path / "one").posed_images
    for keys in "", ",radius=3":
        foreign = raylift.Geometry(f"sfm{keys}", model=tmp_path / "other", references=images)
        own = raylift.Scene(tmp_path / "one", [f"sfm{keys}"])
        scenes = [raylift.Scene(tmp_path / "one", [foreign]), raylift.Scene.of(images, [foreign]),
                  raylift.Scene(tmp_path / "one", own.geometry), raylift.Scene.of(own.references, own.geometry)]
        assert scenes[0] != own == scenes[2]
        for scene, z in zip(scenes, (7, 7, 2, 2)):
            for other in scene, pickle.loads(pickle.dumps(scene)):
                assert other == scene
                for one in other.geometry[0], pickle.loads(pickle.dumps(other.geometry[0])):
                    assert one.lift(images[0], [[320, 240]])["points"][0] == pytest.approx([0, 0, z])
    # What no text says has no state.
    thinned = raylift.Scene(tmp_path / "one", ["sfm"], every=2)
    for unknown in thinned.geometry[0], raylift.Scene.of(thinned.references, thinned.geometry):
        with pytest.raises(raylift.InputError, match="has no state"):
            pickle.dumps(unknown)
