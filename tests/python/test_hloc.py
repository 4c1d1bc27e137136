import pickle
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raylift
from scenes import DEMO, MESH, HlocScene
from synthetic import some


@pytest.fixture(scope="module")
def hloc(tmp_path_factory: pytest.TempPathFactory) -> HlocScene:
    return HlocScene(tmp_path_factory.mktemp("hloc"))


def lines_by_file_name(path: Path) -> list[str]:
    """As hloc names queries: by the file alone."""
    return [line.split("/")[-1] for line in path.read_text().splitlines()]


def test_poses_equal_the_programs(hloc: HlocScene, tmp_path: Path) -> None:
    found = raylift.hloc.localize(DEMO / "model", hloc.query_list, hloc.pairs, hloc.features,
                                  hloc.matches_file, tmp_path / "results.txt", geometry=MESH)
    raylift.localize(tmp_path / "out", model=DEMO / "model", queries=hloc.query_list, pairs=hloc.pairs,
                     features=hloc.features, matches=hloc.matches_file, geometry=MESH)
    assert (tmp_path / "results.txt").read_text().splitlines() == lines_by_file_name(
        tmp_path / "out/poses.txt")
    assert len(found) == len(hloc.queries)
    for name, query in found.items():
        hloc.expect_near(name, some(query.cam_from_world))


def test_logs_are_hlocs(hloc: HlocScene, tmp_path: Path) -> None:
    found = raylift.hloc.localize(hloc.scene, hloc.query_list, hloc.pairs, hloc.features,
                                  hloc.matches_file, tmp_path / "results.txt",
                                  prepend_camera_name=True, top_k=3)
    assert list(raylift.read_poses(tmp_path / "results.txt")) == list(found)
    with open(tmp_path / "results.txt_logs.pkl", "rb") as file:
        logs = pickle.load(file)
    assert set(logs) == {"features", "matches", "retrieval", "loc"}
    for name, log in logs["loc"].items():
        assert log["db"] == [r.name for r in hloc.references[:3]]
        points = len(log["3d_points"])
        assert log["keypoints_query"].shape == (points, 2)
        assert log["PnP_ret"]["num_inliers"] == log["PnP_ret"]["inliers"].sum() > 100
        assert log["PnP_ret"]["covariance"].shape == (6, 6)
        assert log["num_matches"] == found[name].counts["matched"]
        # The look-ups of hloc's visualize_loc_from_log, where there is no model with points.
        inliers = np.array(log["PnP_ret"]["inlier_mask"])
        assert log["indices_db"].shape == inliers.shape == (points,)
        for i, image in enumerate(hloc.references[:3]):
            of_reference = log["indices_db"] == i
            shown = log["keypoints_db"][of_reference]
            assert len(shown) == len(log["keypoints_query"][of_reference]) == len(inliers[of_reference])
            assert (shown >= 0).all() and (shown <= [image.camera.width, image.camera.height]).all()
        assert sum(np.sum(log["indices_db"][inliers] == i) for i in range(3)) > 100


def test_options(hloc: HlocScene, tmp_path: Path) -> None:
    def localize(**options: Any) -> dict[str, raylift.LocalizedQuery]:
        return raylift.hloc.localize(DEMO / "model", hloc.query_list, hloc.pairs, hloc.features,
                                     hloc.matches_file, tmp_path / "results.txt", geometry=[MESH],
                                     **options)

    tight = {"estimation": {"ransac": {"max_error": 0.5}}}
    several: list[dict[str, Any]] = [dict(ransac_thresh=0.5), dict(config=tight), dict(reprojection_threshold_px=0.5)]
    a, b, c = (next(iter(localize(**options).values())) for options in several)
    assert (some(a.cam_from_world).matrix.tolist() == some(b.cam_from_world).matrix.tolist()
            == some(c.cam_from_world).matrix.tolist())
    clustered = next(iter(localize(covisibility_clustering=True).values()))
    of_method = next(iter(localize(method="hloc").values()))
    assert some(clustered.cam_from_world).matrix.tolist() == some(of_method.cam_from_world).matrix.tolist()
    with pytest.raises(raylift.OptionError, match="refinement"):
        localize(config={"refinement": {}})
    with pytest.raises(raylift.OptionError, match="min_num_trials"):
        localize(config={"estimation": {"ransac": {"min_num_trials": 3}}})
    with pytest.raises(raylift.OptionError, match="methods: there is no such option"):
        localize(methods="p3p")


def test_a_reconstruction_is_taken_by_its_write(hloc: HlocScene, tmp_path: Path) -> None:
    model = raylift.ColmapModel.read(DEMO / "model")
    reconstruction: Any = types.SimpleNamespace(write=lambda folder: model.write(folder))
    found = raylift.hloc.localize(reconstruction, str(hloc.query_list), hloc.pairs, hloc.features,
                                  hloc.matches_file, tmp_path / "results.txt", geometry=MESH)
    assert all(found.values())


def test_a_folder_of_pairs_is_the_same_as_hlocs_files(hloc: HlocScene, tmp_path: Path) -> None:
    """Keypoints of a query are told by their pixels, which are hloc's float32."""
    for (query, reference), (of_query, of_reference) in hloc.matches.items():
        pixels = [np.asarray(hloc.keypoints[name], np.float32) for name in (query, reference)]
        name = f"{query}__{reference}".replace("/", "-")
        np.savez(tmp_path / f"{name}.npz", mkpts0=pixels[0][of_query], mkpts1=pixels[1][of_reference],
                 mconf=np.linspace(0, 1, len(of_query)), names=np.array([query, reference]))
    of_files = raylift.Localizer(hloc.scene, features=hloc.features, matches=hloc.matches_file,
                                 pairs=hloc.pairs)
    of_folder = raylift.Localizer(hloc.scene, matches=tmp_path, pairs=hloc.pairs)
    expected = of_files.localize_all(hloc.queries)
    for name, one in of_folder.localize_all(hloc.queries).items():
        np.testing.assert_array_equal(one.problem.query2d, expected[name].problem.query2d)
        assert str(one.cam_from_world) == str(expected[name].cam_from_world)
    best = raylift.Localizer(hloc.scene, matches=tmp_path, pairs=hloc.pairs, min_match_score=0.5)
    for name, one in best.localize_all(hloc.queries).items():
        assert 0 < len(one.problem.query2d) < 0.6 * len(expected[name].problem.query2d)
        hloc.expect_near(name, some(one.cam_from_world))
