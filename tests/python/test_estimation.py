import copy
import inspect
import json
import os
import pickle
import re
import subprocess
import sys
import threading
import typing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import raylift
from raylift import _types
from synthetic import CAMERA, Problem, angle_deg, pose, some

METHODS = ["p3p", "e5p1", "adaptive", "select", "hybrid_ransac", "hloc"]


@pytest.mark.parametrize("method", METHODS)
def test_each_method_finds_the_pose(method: Any) -> None:
    problem = Problem()
    estimate = raylift.estimate_pose(CAMERA, problem.points2d, problem.points3d, **problem.pairs,
                                     method=method)
    problem.expect_near(estimate)
    assert estimate.verdict == "localized" and estimate.failure == "ok"
    assert estimate.confidence > 0.95


@pytest.mark.parametrize("option", ["method", "score", "lo", "refinement"])
def test_types_name_each_value(option: str) -> None:
    known = typing.get_args(typing.get_type_hints(_types.EstimatorOptions)[option])
    with pytest.raises(raylift.OptionError) as error:
        wrong: Any = {option: "another"}
        raylift.estimate_pose(CAMERA, **wrong)
    assert str(error.value) == f"{option} = another: expected {'|'.join(known)}"


def test_points_alone_and_pairs_alone() -> None:
    problem = Problem()
    problem.expect_near(raylift.estimate_pose(CAMERA, problem.points2d, problem.points3d))
    problem.expect_near(raylift.estimate_pose(CAMERA, **problem.pairs))


def test_result() -> None:
    problem = Problem()
    estimate = raylift.estimate_pose(CAMERA, problem.points2d, problem.points3d, **problem.pairs)
    right = problem.num_right
    assert estimate.inliers_2d3d.dtype == bool and estimate.inliers_2d3d.shape == (200,)
    assert estimate.inliers_2d3d[:right].mean() > 0.95
    assert estimate.inliers_2d3d[right:].mean() < 0.1
    assert estimate.inliers_2d2d.shape == (600,)
    assert estimate.num_inliers_2d3d == estimate.inliers_2d3d.sum()
    assert estimate.num_inliers_2d2d == estimate.inliers_2d2d.sum()
    assert 0.9 * right < estimate.inlier_keypoints <= estimate.num_keypoints == 200
    assert some(estimate.covariance).shape == (6, 6)
    assert np.linalg.eigvalsh(some(estimate.covariance)).min() > 0
    assert 0 < estimate.rotation_sigma_deg < 0.2 and 0 < estimate.position_sigma < 0.03
    assert estimate.solver in ("p3p", "e5p1", "d3p1") and estimate.iterations >= 100
    assert estimate.position_observable and estimate.refined_camera is None
    assert 0.2 < some(estimate.noise)["keypoint_px"] < 1
    assert "localized" in repr(estimate)


def test_what_the_scene_holds_twice_has_an_alternative() -> None:
    problem = Problem(wrong=0)
    shift = np.array([3, 0.5, 0])
    of_most = np.arange(len(problem.points3d)) % 4 != 0
    estimate = raylift.estimate_pose(CAMERA, problem.points2d, problem.points3d + shift * of_most[:, None])
    assert estimate.verdict == "doubtful"
    assert raylift.estimate_pose(CAMERA, problem.points2d, problem.points3d).alternatives == []
    alternative, = estimate.alternatives
    assert 0.4 < alternative["probability"] <= 1 - estimate.confidence
    assert some(alternative["covariance"]).shape == (6, 6)
    between = some(estimate.cam_from_world).center - alternative["cam_from_world"].center
    assert np.allclose(abs(between), abs(shift), atol=0.1)
    copied = pickle.loads(pickle.dumps(estimate))
    assert copied == estimate and len(copied.alternatives) == 1


def test_names_of_pycolmap_and_poselib() -> None:
    problem = Problem(wrong=0)
    mine = raylift.estimate_pose(CAMERA, problem.points2d, problem.points3d)
    theirs = raylift.estimate_pose(camera=CAMERA, points2D=problem.points2d, points3D=problem.points3d)
    assert theirs.cam_from_world == mine.cam_from_world
    assert mine.num_inliers == mine.inlier_mask.sum() == mine.num_inliers_2d3d
    both = raylift.estimate_pose(CAMERA, problem.points2d, problem.points3d, **problem.pairs)
    assert both.num_inliers == both.inlier_mask.sum() == both.num_inliers_2d3d + both.num_inliers_2d2d
    with pytest.raises(raylift.InputError, match="points2d and points2D: expected one"):
        raylift.estimate_pose(CAMERA, problem.points2d, points2D=problem.points2d, points3d=problem.points3d)

    near = raylift.Rigid3(problem.truth.qvec, problem.truth.tvec + 0.01)
    refined = raylift.estimate_pose(CAMERA, problem.points2d, problem.points3d, initial_pose=near)
    problem.expect_near(refined)
    assert refined.iterations == 0


def test_some_pixels_may_lie_outside_of_their_image() -> None:
    problem = Problem(wrong=0)
    half = raylift.Camera("SIMPLE_RADIAL", 600, 450, CAMERA.params)
    problem.expect_near(raylift.estimate_pose(half, problem.points2d, problem.points3d, **problem.pairs))
    tiny, of_references = raylift.Camera("SIMPLE_RADIAL", 1, 1, CAMERA.params), dict(problem.pairs)
    of_references["references"] = [(tiny, reference.cam_from_world) for reference in problem.references]
    several: list[tuple[str, raylift.Camera, dict[str, Any]]] = [
        ("points2d: 200 of 200", tiny, dict(points2d=problem.points2d, points3d=problem.points3d)),
        ("query2d: 600 of 600", tiny, problem.pairs), ("reference2d: 600 of 600", CAMERA, of_references)]
    for name, camera, arguments in several:
        with pytest.raises(raylift.InputError, match=rf"^{name} lie outside of the image \(1 x 1\): are they those of"):
            raylift.PoseProblem(camera, **arguments)


def test_no_pose_is_a_result() -> None:
    estimate = raylift.estimate_pose(CAMERA, [[1, 2]], [[1, 2, 3]])
    assert isinstance(estimate, raylift.PoseEstimate)
    assert not estimate and estimate.cam_from_world is None and estimate.covariance is None
    assert estimate.verdict == "failed" and estimate.failure == "too few matches"
    assert "too few" in repr(estimate)
    assert not raylift.estimate_pose(CAMERA)


def test_arrays_of_any_layout_and_type_give_the_same() -> None:
    problem = Problem(noise_px=0)
    points2d = np.round(problem.points2d)
    points3d = problem.points3d.astype(np.float32)

    def pose_of(a: Any, b: Any) -> Any:
        return some(raylift.estimate_pose(CAMERA, a, b).cam_from_world).matrix.tolist()

    expected = pose_of(points2d, points3d.astype(float))
    wide = np.zeros((len(points3d), 6))
    wide[:, ::2] = points3d
    for a, b in [(points2d.astype(int), points3d), (points2d.tolist(), points3d.tolist()),
                 (np.asfortranarray(points2d), wide[:, ::2]), (points2d.astype(np.int16), points3d),
                 (points2d.astype(">f4"), np.asfortranarray(points3d))]:
        assert pose_of(a, b) == expected

    class Tensor:  # as torch's: known by __array__ alone
        def __init__(self, array: NDArray[Any]) -> None:
            self.array = array

        def __array__(self, dtype: Any = None, copy: Any = None) -> NDArray[Any]:
            return self.array

    class Capsule:  # by __dlpack__ alone
        def __init__(self, array: NDArray[np.float64]) -> None:
            self.array = array

        def __dlpack__(self, **options: Any) -> Any:
            return self.array.__dlpack__(**options)

        def __dlpack_device__(self) -> Any:
            return self.array.__dlpack_device__()

    assert pose_of(Tensor(points2d), Tensor(points3d)) == expected
    assert pose_of(Capsule(points2d), Capsule(points3d.astype(float))) == expected


def test_priors_of_position_and_gravity() -> None:
    problem = Problem(noise_px=2)
    down = np.array([0.0, 0.0, -2.0])
    rotation, position = problem.truth.rotation, problem.truth.center
    arguments = (CAMERA, problem.points2d, problem.points3d)
    plain = raylift.estimate_pose(*arguments, method="p3p")
    exact = raylift.estimate_pose(*arguments, method="p3p", position_prior=(position, 0))
    assert np.linalg.norm(some(exact.cam_from_world).center - position) < 1e-4
    upright = raylift.estimate_pose(
        *arguments, method="p3p", gravity_prior=(rotation @ down, list(down), 0.001))
    tilted = some(upright.cam_from_world).rotation @ down - rotation @ down
    assert np.degrees(np.linalg.norm(tilted) / 2) < 0.01
    assert some(plain.cam_from_world).matrix.tolist() != some(exact.cam_from_world).matrix.tolist()
    turned = raylift.estimate_pose(*arguments, method="p3p", orientation_prior=(rotation, 0.02))
    assert angle_deg(some(turned.cam_from_world), problem.truth) < 0.01 < angle_deg(
        some(plain.cam_from_world), problem.truth)
    right = rotation.T @ [1, 0, 0]
    headed = raylift.estimate_pose(*arguments, method="p3p", heading_prior=(
        [1, 0, 0], right * [1, 1, 0], [0, 0, -1], 0.01))

    def heading_error_deg(estimate: raylift.PoseEstimate) -> float:
        found = some(estimate.cam_from_world).rotation.T @ [1, 0, 0]
        return abs(float(np.degrees(np.arctan2(*found[:2]) - np.arctan2(*right[:2]))))

    assert heading_error_deg(headed) < 1e-3 < 0.05 < heading_error_deg(plain)
    with pytest.raises(raylift.InputError, match=r"position_prior: expected an array of shape \(3,\)"):
        raylift.estimate_pose(*arguments, position_prior=([1, 2], 1))
    with pytest.raises(raylift.InputError, match="gravity_prior, down_in_cam: expected a direction"):
        raylift.estimate_pose(*arguments, gravity_prior=([0, 0, 0], down, 1))


@pytest.mark.parametrize("arguments, message", [
    (dict(points2d=np.zeros((3, 3)), points3d=np.zeros((3, 3))),
     r"points2d: expected an array of shape \(N, 2\), found \(3, 3\)"),
    (dict(points2d=np.zeros((3, 2)), points3d=np.zeros((4, 3))),
     "points2d and points3d: expected as many rows, found 3 and 4"),
    (dict(points2d=np.zeros((3, 2)), points3d=None), "found 3 and 0"),
    (dict(points2d="pixels", points3d=None), "points2d: expected an array"),
    (dict(points2d=np.zeros((1, 2)), points3d=np.zeros((1, 3)), point_sigmas=[1, 2]),
     r"point_sigmas: expected an array of shape \(1,\)"),
    (dict(points2d=np.zeros((1, 2)), points3d=np.zeros((1, 3)), point_references=[0]),
     "point_references, row 0: expected an index into 0 references, found 0"),
    (dict(query2d=np.zeros((1, 2)), reference2d=np.zeros((1, 2)), reference_index=[2],
          references=[(CAMERA, np.eye(4))]), "reference_index, row 0.* found 2"),
    (dict(query2d=np.zeros((1, 2)), reference2d=np.zeros((1, 2)),
          references=[(CAMERA, np.eye(4))] * 2), "reference_index is missing"),
    (dict(points2d=np.zeros((1, 2)), points3d=np.zeros((1, 3)), point_matches=[0]),
     "point_matches, row 0"),
    (dict(references=[(CAMERA, np.eye(4))], reference_clusters=[1, 2]), "reference_clusters"),
    (dict(points2d=np.zeros((1, 2)), points3d=np.zeros((1, 3)), point_sigmas=[-1]),
     "point_sigmas, row 0: expected a standard deviation, found -1"),
    (dict(query2d=np.zeros((1, 2)), reference2d=np.zeros((1, 2)), reference_index=[0.7],
          references=[(CAMERA, np.eye(4))]), "reference_index: expected integers, found 0.7"),
    (dict(query2d=np.zeros((1, 2)), reference2d=np.zeros((1, 2)), reference_index=np.array([2.0**63]),
          references=[(CAMERA, np.eye(4))]), "reference_index: expected integers .* found 9.2"),
    (dict(points2d=np.ma.zeros((1, 2)), points3d=np.zeros((1, 3))), "points2d: a masked array"),
    (dict(references=[(CAMERA, np.eye(4).T + np.outer([0, 0, 0, 1], [1, 2, 3, 0]))]),
     r"last row of a 4 x 4 matrix, found \(1, 2, 3, 1\); is it transposed"),
    (dict(references=[(CAMERA, np.diag([1, 1, 1, np.nan]))]), "last row"),
    (dict(references=[(CAMERA, (np.eye(3), [0, np.nan, 0]))]), "translation: expected finite"),
])
def test_wrong_arrays_are_input_errors(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(raylift.InputError, match=message):
        raylift.estimate_pose(CAMERA, **arguments)


@pytest.mark.parametrize("option, message", [
    (dict(method="p4p"), r"method = p4p: expected p3p\|e5p1"),
    (dict(min_iterations=-1), "^min_iterations = -1: "),
    (dict(reprojection_threshold_px=0), "^reprojection_threshold_px = 0: "),
    (dict(confidence="high"), "confidence = 'high': expected a number"),
    (dict(min_iteration=3), "min_iteration: there is no such option; .*min_iterations"),
])
def test_wrong_options_are_option_errors(option: dict[str, Any], message: str) -> None:
    with pytest.raises(raylift.OptionError, match=message):
        raylift.estimate_pose(CAMERA, **option)
    assert issubclass(raylift.OptionError, ValueError) and issubclass(raylift.InputError, ValueError)


def test_options_are_those_of_the_program_with_its_defaults(tmp_path: Path) -> None:
    problem = tmp_path / "problem.json"
    raylift.PoseProblem(CAMERA, name="q").write(problem)
    text = subprocess.run([os.environ["RAYLIFT"], "estimate", "--help"], check=True, text=True,
                          capture_output=True).stdout
    group = text[text.index("\nEstimator:"):].split("\nRunning:")[0]
    # "--name TEXT=default" or, by later versions of CLI11, "--name TEXT [default]".
    options = re.findall(r"^  --([a-z0-9-]+)(?: ([A-Z]+)(?:(?:=| \[)([^\s\]]+))?)?", group,
                         flags=re.MULTILINE)
    assert {name.replace("-", "_") for name, _, _ in options} == set(_types.EstimatorOptions.__annotations__)
    documented = str(inspect.getdoc(raylift.estimate_pose))
    for name, kind, default in options:
        none = "None" if kind else "False"  # a value that may be left open, or a flag
        shown = f'"{default}"' if default and default[0].isalpha() else default or none
        assert f'{name.replace("-", "_")}={shown}' in documented


def test_problem_keeps_what_it_is_given(tmp_path: Path) -> None:
    data = Problem(points=20, wrong=0)
    problem = raylift.PoseProblem(
        CAMERA, data.points2d, data.points3d, point_references=np.zeros(20), point_matches=range(20),
        point_keypoints=np.arange(20), query_keypoints=np.tile(np.arange(20), 3), name="query.jpg",
        **data.pairs)
    problem.write(tmp_path / "problem.json")
    for p in (problem, raylift.PoseProblem.read(str(tmp_path / "problem.json")),
              pickle.loads(pickle.dumps(problem)), copy.deepcopy(problem)):
        assert p.name == "query.jpg" and p.camera == CAMERA
        assert [r.name for r in p.references] == ["0.jpg", "1.jpg", "2.jpg"]
        assert (p.points2d == data.points2d).all() and (p.points3d == data.points3d).all()
        assert (p.query2d == data.pairs["query2d"]).all()
        assert (p.reference2d == data.pairs["reference2d"]).all()
        assert (p.reference_index == data.pairs["reference_index"]).all()
        assert (p.point_references == 0).all() and (p.point_matches == np.arange(20)).all()
        assert (p.point_keypoints == np.arange(20)).all()
        assert (p.query_keypoints == np.tile(np.arange(20), 3)).all()
        assert "20 2D-3D" in repr(p)
    with pytest.raises(raylift.InputError, match="missing.json"):
        raylift.PoseProblem.read(tmp_path / "missing.json")


def test_estimates_equal_the_programs(tmp_path: Path) -> None:
    data = Problem()
    problem = raylift.PoseProblem(CAMERA, data.points2d, data.points3d, name="q", **data.pairs)
    problem.write(tmp_path / "q.json")
    subprocess.run([os.environ["RAYLIFT"], "estimate", tmp_path / "q.json", "--quiet", "--json",
                    tmp_path / "out.json"], check=True)
    row = json.loads((tmp_path / "out.json").read_text())[0]
    pose = raylift.estimate_pose(CAMERA, data.points2d, data.points3d, name="q",
                                 **data.pairs).cam_from_world
    assert some(pose).qvec.tolist() == row["qvec"] and some(pose).tvec.tolist() == row["tvec"]


def test_many_at_once_with_progress() -> None:
    problems = []
    for seed in range(6):
        data = Problem(seed)
        problems.append(raylift.PoseProblem(CAMERA, data.points2d, data.points3d, name=str(seed)))
    told = []
    estimates = raylift.estimate_all(problems, independent=True, threads=2,
                                     progress=lambda *a: told.append(a))
    assert told[-1] == (6, 6, "problems")
    for problem, estimate in zip(problems, estimates):
        alone = raylift.estimate_pose(CAMERA, problem.points2d, problem.points3d, name=problem.name)
        assert some(alone.cam_from_world).matrix.tolist() == some(estimate.cam_from_world).matrix.tolist()


def test_problems_of_a_scene_are_estimated_as_by_the_program(tmp_path: Path) -> None:
    names = [f"{seed}.jpg" for seed in range(5)]
    for seed, name in enumerate(names):
        data = Problem(seed)
        raylift.PoseProblem(CAMERA, data.points2d, data.points3d, name=name,
                            **data.pairs).write(tmp_path / f"{name}.json")
    problems = [raylift.PoseProblem.read(tmp_path / f"{name}.json") for name in names]
    for independent in (False, True):
        subprocess.run([os.environ["RAYLIFT"], "estimate", *sorted(tmp_path.glob("*.jpg.json")), "--quiet",
                        "--json", tmp_path / "out.json", *["--independent"] * independent], check=True)
        rows = {row["name"]: row for row in json.loads((tmp_path / "out.json").read_text())}
        found = raylift.estimate_all(problems[::-1], independent=independent)
        for problem, estimate in zip(problems[::-1], found):
            pose, row = estimate.cam_from_world, rows[problem.name]
            assert some(pose).qvec.tolist() == row["qvec"] and some(pose).tvec.tolist() == row["tvec"]
            alone = raylift._core.estimate(problem).cam_from_world
            assert (alone == pose) == independent


def test_an_exception_of_progress_ends_the_call() -> None:
    def fail(done: int, total: int, what: str) -> None:
        raise KeyError(what)

    with pytest.raises(KeyError, match="problems"):
        raylift.estimate_all([raylift.PoseProblem(CAMERA)], progress=fail)


def slow_problem() -> raylift.PoseProblem:
    """No pose agrees with it, so that RANSAC draws all that it may."""
    rng = np.random.default_rng(0)
    return raylift.PoseProblem(CAMERA, rng.uniform(0, 480, (2000, 2)), rng.normal(0, 3, (2000, 3)))


def test_two_threads_estimate_side_by_side() -> None:
    problems = [slow_problem()] * 100000
    begun = [False, False]

    class Met(Exception):
        pass

    def work(mine: int, other: int) -> None:
        def meet(done: int, total: int, what: str) -> None:
            begun[mine] = True
            if begun[other]:
                raise Met

        with pytest.raises(Met):
            raylift.estimate_all(problems, threads=1, progress=meet, method="p3p")
        ended.append(mine)

    # No thread takes the lock from another one that does not give it away: neither call would end if
    # it held the lock while it works.
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1000)
    try:
        ended: list[int] = []
        workers = [threading.Thread(target=work, args=(i, 1 - i)) for i in range(2)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
    finally:
        sys.setswitchinterval(interval)
    assert sorted(ended) == [0, 1]


def test_ctrl_c_ends_a_long_call() -> None:
    script = """
import os, signal, sys, threading
sys.path.insert(0, os.environ["TESTS"])
import raylift
from test_estimation import slow_problem
problems = [slow_problem()] * 100000
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what runs in a shell's background
threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
try:
    raylift.estimate_all(problems, method="p3p")
except KeyboardInterrupt:
    print("stopped")
"""
    run = subprocess.run([sys.executable, "-c", script], text=True, capture_output=True, timeout=200,
                         env=dict(os.environ, TESTS=os.path.dirname(__file__)))
    assert run.stdout == "stopped\n", run.stderr


def test_ctrl_c_ends_one_long_estimate() -> None:
    script = """
import os, signal, sys, threading
sys.path.insert(0, os.environ["TESTS"])
import numpy as np, raylift
from test_estimation import CAMERA
signal.signal(signal.SIGINT, signal.default_int_handler)
threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
random = np.random.default_rng(0)
points2d, points3d = random.uniform(0, 400, (2000, 2)), random.uniform(-1, 1, (2000, 3))
try:
    raylift.estimate_pose(CAMERA, points2d, points3d, max_iterations=2**30, min_iterations=2**30)
except KeyboardInterrupt:
    print("stopped")
"""
    run = subprocess.run([sys.executable, "-c", script], text=True, capture_output=True, timeout=60,
                         env=dict(os.environ, TESTS=os.path.dirname(__file__)))
    assert run.stdout == "stopped\n", run.stderr


@pytest.mark.parametrize("call", ["caster.render(camera, pose, ['depth', 'normals'], supersampling=4)",
                                  "caster.cast([[0, 0, 1]], directions)",
                                  "raylift.Geometry(mesh).lift(('PINHOLE 400 400 300 300 200 200', pose), pixels)",
                                  "raylift.Lifter(mesh).lift(('PINHOLE 400 400 300 300 200 200', pose), pixels)"])
def test_ctrl_c_ends_long_work_on_meshes(call: str) -> None:
    # Asked for at a tenth of a call, the end costs less than half of it (where the call is no short
    # one), in CPU time of one process.
    script = f"""
import os, signal, time, threading
import numpy as np, raylift
signal.signal(signal.SIGINT, signal.default_int_handler)
random = np.random.default_rng(0)
mesh = raylift.Mesh.read(os.environ["RAYLIFT_SOURCE"] + "/assets/demo/scene.obj")
caster, camera, pose = raylift.RayCaster(mesh), "PINHOLE 1000 1000 750 750 500 500", raylift.Rigid3()
pixels, directions = random.uniform(0, 400, (4000000, 2)), random.normal(size=(4000000, 3))
start, cpu_start = time.monotonic(), time.process_time()
{call}
whole, cpu_whole = time.monotonic() - start, time.process_time() - cpu_start
asked = []
def ask():
    asked.append(time.process_time())
    os.kill(os.getpid(), signal.SIGINT)
threading.Timer(whole / 10, ask).start()
try:
    {call}
except KeyboardInterrupt:
    assert time.process_time() - asked[0] < max(cpu_whole / 2, 0.2)
    print("stopped")
"""
    run = subprocess.run([sys.executable, "-c", script], text=True, capture_output=True, timeout=600)
    assert run.stdout == "stopped\n", run.stderr


def test_minimal_solvers_find_the_pose_among_few() -> None:
    problem = Problem(noise_px=0, wrong=0)
    truth, points = problem.truth, problem.points3d
    in_cam = truth.transform(points)
    poses = [reference.cam_from_world for reference in problem.references]
    in_reference = [pose.transform(points) for pose in poses]
    down = np.array([0.2, 0.1, -0.9])
    found = [
        raylift.solve_p3p(in_cam[:3], points[:3]),
        raylift.solve_gp3p(np.zeros((3, 3)) + np.eye(3), in_cam[:3] - np.eye(3), points[:3]),
        raylift.solve_e5p1(in_cam[:6], np.vstack([in_reference[0][:5], in_reference[1][5:6]]), *poses[:2]),
        raylift.solve_d3p1(in_cam[:4], 3 * in_reference[0][:3], in_reference[1][3], *poses[:2]),
        raylift.solve_up2p(in_cam[:2], points[:2], truth.rotation @ down, down),
        raylift.solve_known_center(in_cam[:2], points[:2], truth.center),
    ]
    for solutions in found:
        errors = [np.abs(pose.matrix - truth.matrix).max() for pose in solutions]
        assert 0 < len(errors) <= 10 and min(errors) < 1e-6
    with pytest.raises(raylift.InputError, match=r"rays: expected an array of shape \(3, 3\), found 2"):
        raylift.solve_p3p(in_cam[:2], points[:3])


def test_a_pose_that_is_nearly_known_is_refined() -> None:
    problem = Problem()
    asked = raylift.PoseProblem(CAMERA, problem.points2d, problem.points3d, **problem.pairs)
    near = pose([0.102, -0.199, 0.05], problem.truth.center + 0.01)
    problem.expect_near(raylift.refine_pose(asked, near))
    problem.expect_near(raylift.refine_pose(asked, near, method="p3p"))
    with pytest.raises(raylift.OptionError, match="alpha"):
        raylift.refine_pose(asked, near, alpha=-1)
