"""Makes one call of each command fail after the other: faults_test.py RAYLIFT SHIM WORK_FOLDER
[--points N] [--stacks N] [--command NAME] [--call NAME].

The shim (fault_shim.cc) lets the n-th allocation, read, write, new file, rename, mapping or thread of a
run fail. Whatever it is, the command must end by itself and soon, either well and with the results of an
undisturbed run or with an exit code that fits and one line which says what is wrong; its outputs are then
whole or absent, nothing temporary is left, and the same command (with --resume where it has that) ends
with the results of an undisturbed run.

Of "power" the run ends instead of the n-th sync, rename or new folder, and all is lost that was not synced, names in
folders, too. Whatever a manifest that is left promises must be there (`verify`), the same command must end as above;
and of a run that has ended nothing may be lost.

Of each command and call at most N points (3) are tried, evenly spread with the first and the last among
them; 0: all of them. Of memory they begin where the command does, besides two before; with --stacks, instead,
the first allocation of each call stack (its ten innermost functions) fails, of N stacks drawn at random (0: of all)
that are the command's own, as what follows from a failure is told by where it happens. Exit code 77 where the shim
cannot work.
"""

import argparse
import json
import math
import os
import pathlib
import random
import re
import shutil
import struct
import subprocess
import sys
import time

CALLS = ("memory", "read", "write", "create", "rename", "sync", "map", "thread")
NO_MEMORY, BAD_INPUT, BAD_OUTPUT = 6, 3, 5
# By call: the exit codes of a command that could not do without it.
CODES = {"memory": {NO_MEMORY}, "map": {NO_MEMORY, BAD_INPUT, BAD_OUTPUT}, "thread": {NO_MEMORY},
         "read": {BAD_INPUT, BAD_OUTPUT}, "write": {BAD_OUTPUT}, "create": {BAD_OUTPUT}, "rename": {BAD_OUTPUT},
         "sync": {BAD_OUTPUT}}
MOST_SECONDS = 120
TIMES = {"milliseconds", "seconds", "match_ms", "lift_ms", "filter_ms", "estimate_ms", "time_ms", "started",
         "stage_seconds", "thread_seconds"}


# ---- a small scene ----

def write_room(path):
    """A room whose walls have a random color at each vertex."""
    rng, steps, size = random.Random(1), 16, (6.0, 5.0, 3.0)
    vertices, faces = [], []
    for axis in range(3):
        a, b = (other for other in range(3) if other != axis)
        for side in (0, 1):
            first = len(vertices)
            for i in range(steps + 1):
                for j in range(steps + 1):
                    point = [0.0, 0.0, 0.0]
                    point[axis], point[a], point[b] = size[axis] * side, size[a] * i / steps, size[b] * j / steps
                    vertices.append((*point, *(rng.randrange(256) for _ in range(3))))
            for i in range(steps):
                for j in range(steps):
                    corner = first + i * (steps + 1) + j
                    faces.append((corner, corner + 1, corner + steps + 1))
                    faces.append((corner + 1, corner + steps + 2, corner + steps + 1))
    header = ("ply\nformat binary_little_endian 1.0\n"
              f"element vertex {len(vertices)}\n"
              + "".join(f"property float {name}\n" for name in "xyz")
              + "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
              + f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n")
    path.write_bytes(header.encode() + b"".join(struct.pack("<3f3B", *v) for v in vertices)
                     + b"".join(struct.pack("<B3i", 3, *f) for f in faces))


def write_model(folder, names, turn):
    """Cameras near the room's middle that look along its floor."""
    folder.mkdir()
    (folder / "cameras.txt").write_text("1 PINHOLE 160 120 130 130 80 60\n")
    (folder / "points3D.txt").write_text("")
    lines = []
    for k, name in enumerate(names):
        yaw = 0.15 * k + turn
        center = (3 + 0.3 * math.sin(k + turn), 2.5 + 0.3 * math.cos(2 * k), 1.5)
        rows = ((math.sin(yaw), -math.cos(yaw), 0), (0, 0, -1), (math.cos(yaw), math.sin(yaw), 0))
        t = [-sum(r * c for r, c in zip(row, center)) for row in rows]
        w = math.sqrt(1 + rows[0][0] + rows[1][1] + rows[2][2]) / 2
        q = (w, (rows[2][1] - rows[1][2]) / (4 * w), (rows[0][2] - rows[2][0]) / (4 * w),
             (rows[1][0] - rows[0][1]) / (4 * w))
        lines.append(f"{k + 1} {' '.join(map(repr, q))} {' '.join(map(repr, t))} 1 {name}\n\n")
    (folder / "images.txt").write_text("".join(lines))


EXPERIMENT = """title = "Faults"
[scenes.room]
model = "model"
images = "rendered/color"
query_images = "photos/color"
queries = "queries.txt"
ground_truth = "truth"
thresholds = "0.1,1"
top_k = 2
[scenes.room.geometry]
mesh = "mesh:room.ply"
[[grid]]
method = ["p3p", "adaptive"]
[[table]]
name = "methods"
rows = ["method"]
columns = ["every"]
"""


def write_tum(folder):
    (folder / "rgb").mkdir(parents=True)
    times = range(10)
    for t in times:
        (folder / "rgb" / f"{t}.000000.png").touch()
    (folder / "rgb.txt").write_text("".join(f"{t}.000000 rgb/{t}.000000.png\n" for t in times))
    (folder / "depth.txt").write_text("")
    (folder / "groundtruth.txt").write_text("".join(f"{t}.0 {t} 0 0 0 0 0 1\n" for t in times))


def make_inputs(raylift, work):
    write_room(work / "room.ply")
    write_model(work / "model", ["r0.png", "r1.png", "r2.png"], 0.0)
    write_model(work / "truth", ["q0.png", "q1.png"], 0.07)
    (work / "queries.txt").write_text(
        "".join(f"q{i}.png PINHOLE 160 120 130 130 80 60\n" for i in range(2)))
    (work / "experiment.toml").write_text(EXPERIMENT)
    write_tum(work / "tum")
    for cameras, out in (("model", "rendered"), ("truth", "photos")):
        run_plain(raylift, work, RENDER + ["--model", cameras, "--out", out])
    for shard in (0, 1):
        run_plain(raylift, work, LOCALIZE + ["--out", f"shard{shard}", "--shard", f"{shard}/2"])
    run_plain(raylift, work, LOCALIZE + ["--out", "run", "--write-problems", "problems"])
    (work / "poses.txt").write_bytes((work / "run" / "poses.txt").read_bytes())


# ---- the commands ----

RENDER = ["render", "--geometry", "mesh:room.ply", "--products", "depth,color", "--format", "npy",
          "--format", "color=png", "--threads", "2", "--quiet"]
LOCALIZE = ["localize", "--model", "model", "--images", "rendered/color", "--geometry", "mesh:room.ply",
            "--queries", "queries.txt", "--query-images", "photos/color", "--top-k", "2", "--max-features",
            "300", "--threads", "2", "--quiet"]


class Command:
    """One command on the scene; `arguments` name its output OUT. `resume` is the option by which it goes on
    or begins anew, None where it simply is run again."""

    def __init__(self, name, arguments, resume=None, copies=()):
        self.name, self.arguments, self.resume, self.copies = name, arguments, resume, copies

    def line(self, out, again=False):
        line = [argument.replace("OUT", out) for argument in self.arguments]
        return line + ([self.resume] if again and self.resume else [])

    def prepare(self, work, out):
        """Folders that the command finds where its outputs go."""
        (work / out).mkdir()
        for source in self.copies:
            shutil.copytree(work / source, work / out / source)


COMMANDS = [
    Command("localize", LOCALIZE + ["--out", "OUT/o", "--cache", "OUT/cache", "--write-problems", "OUT/problems",
                                    "--pictures", "1", "--write-model", "OUT/model"], "--resume"),
    Command("continuous", LOCALIZE + ["--continuous", "--out", "OUT/o", "--write-problems", "OUT/problems", "--pictures",
                                      "1"], "--resume"),
    Command("estimate", ["estimate", "problems", "--out", "OUT/o", "--threads", "2", "--quiet"], "--resume"),
    Command("evaluate", ["evaluate", "--ground-truth", "truth", "--poses", "poses.txt", "--json", "OUT/t.json",
                         "--csv", "OUT/t.csv", "--report", "OUT/report", "--geometry", "mesh:room.ply"]),
    Command("pairs", ["pairs", "--model", "model", "--images", "rendered/color", "--top-k", "2", "--threads",
                      "2", "--quiet", "--out", "OUT/pairs.txt"]),
    Command("experiment", ["experiment", "experiment.toml", "--out", "OUT/o", "--own-features", "--threads",
                           "2", "--quiet"], "--resume"),
    Command("import", ["import", "tum", "tum", "--camera", "PINHOLE 64 48 50 50 32 24", "--out", "OUT/o", "--quiet"]),
    Command("export", ["export", "glb", "run", "--out", "OUT/scene.glb", "--threads", "2", "--quiet"]),
    Command("perturb", ["perturb", "--model", "model", "--geometry", "mesh:room.ply", "--out", "OUT/o", "--warp",
                        "0.05", "--noise", "0.01", "--threads", "2", "--quiet"]),
    Command("compare", ["compare", "--model", "model", "--images", "rendered/color", "--geometry",
                        "mesh=mesh:room.ply", "--geometry", "maps=depth:rendered/depth", "--truth", "mesh",
                        "--queries", "queries.txt", "--query-images", "photos/color", "--ground-truth", "truth",
                        "--out", "OUT/o", "--report", "OUT/report", "--threads", "2", "--quiet"], "--resume"),
    Command("doctor", ["doctor", "--model", "model", "--images", "rendered/color", "--geometry", "mesh:room.ply",
                       "--threads", "2", "--quiet"]),
    Command("render", RENDER + ["--model", "model", "--out", "OUT/o"], "--resume"),
    Command("prepare", ["prepare", *LOCALIZE[1:], "--out", "OUT/o", "--cache", "OUT/cache"]),
    Command("views", ["views", "--geometry", "mesh:room.ply", "--mode", "around", "--count", "3", "--threads", "2",
                      "--out", "OUT/o"], "--overwrite"),
    Command("color", ["color", "room.ply", "--model", "model", "--images", "rendered/color", "--threads", "2",
                       "--quiet", "--out", "OUT/c.ply"]),
    Command("status", ["status", "rendered"]),
    Command("merge", ["merge", "OUT/o", "OUT/shard0", "OUT/shard1"], copies=("shard0", "shard1")),
    Command("verify", ["verify", "rendered", "--threads", "2", "--quiet"]),
]


# ---- runs and what they leave ----

def run_plain(raylift, work, line):
    done = subprocess.run([raylift, *line], cwd=work, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(line)} ended with {done.returncode}: {done.stderr.strip()}")
    return done


def run_with_fault(raylift, shim, work, line, call, at, journal=None):
    """(exit code, stdout, stderr, how many such calls there were: None where main did not end); `at` is a call's
    number or a stack's name."""
    report = work / "report.txt"
    report.unlink(missing_ok=True)
    environment = dict(os.environ, LD_PRELOAD=str(shim), RAYLIFT_FAULT_CALL=call, RAYLIFT_FAULT_REPORT=str(report))
    if journal:
        environment["RAYLIFT_FAULT_JOURNAL"] = str(journal)
    environment["RAYLIFT_FAULT_STACK" if isinstance(at, str) else "RAYLIFT_FAULT_AT"] = str(at)
    try:
        done = subprocess.run([raylift, *line], cwd=work, env=environment, capture_output=True, text=True,
                              timeout=MOST_SECONDS, errors="replace")
    except subprocess.TimeoutExpired:
        return "time-out", "", "", None
    return done.returncode, done.stdout, done.stderr, int(report.read_text()) if report.exists() else None


def without_times(value):
    if isinstance(value, dict):
        return {key: without_times(other) for key, other in value.items() if key not in TIMES}
    if isinstance(value, list):
        return [without_times(other) for other in value]
    return value


def contents(file, out):
    """A file's bytes without times and without the folder that it is in."""
    data = file.read_bytes()
    if file.suffix in (".json", ".jsonl"):
        lines = data.decode().splitlines() if file.suffix == ".jsonl" else [data.decode()]
        # A manifest has its lines in the order in which they were done.
        data = "\n".join(sorted(json.dumps(without_times(json.loads(line))) for line in lines)).encode()
    # A summary has the command's line.
    return data.replace(out.encode(), b"OUT").replace(b" --resume", b"").replace(b" --overwrite", b"")


def files_of(work, out):
    return {str(file.relative_to(work / out)): file for file in sorted((work / out).rglob("*")) if file.is_file()}


# The page of a comparison has gaps where photographs cannot be read.
WITH_GAPS = {("compare", "read"): "report/index.html"}

# In the order in which threads have come to it; and of the run that ended, not of all its parts.
UNORDERED = re.compile(r"features\.h5$|(^|/)timing\.jsonl$")


class Undisturbed:
    """What two runs that nothing disturbs leave. Files in which they differ, by a time of their own, are
    only looked for."""

    def __init__(self, raylift, work, command):
        kept = []
        for i in (1, 2):
            out = f"plain{i}-{command.name}"
            command.prepare(work, out)
            done = run_plain(raylift, work, command.line(out))
            kept.append({name: contents(file, out) for name, file in files_of(work, out).items()})
            shutil.rmtree(work / out)
        if kept[0].keys() != kept[1].keys():
            sys.exit(f"{command.name}: two runs leave other files: {kept[0].keys() ^ kept[1].keys()}")
        self.files, self.varying = kept[0], {name for name in kept[0] if kept[0][name] != kept[1][name]}
        self.stdout = done.stdout.replace(out, "OUT")

    def differs(self, work, out, name, file):
        if name not in self.files:
            return f"{name} is a file that no other run leaves"
        try:
            now = contents(file, out)
        except ValueError as error:
            return f"{name} is not whole: {error}"
        if name not in self.varying and not UNORDERED.search(name) and now != self.files[name]:
            return f"{name} is another"
        return None

    def differences(self, work, out):
        found = files_of(work, out)
        named = [self.differs(work, out, name, file) for name, file in found.items()]
        return [text for text in named if text] + [f"{name} is missing" for name in self.files if name not in found]


# Grow line by line, or are kept from run to run: whole as far as they go.
GROWING = re.compile(r"manifest[^/]*\.jsonl$|(^|/)cache/|/cells/")


def left_behind(work, out, undisturbed, ended_at_once):
    """What is wrong with the outputs of a command that has failed."""
    wrong = []
    for name, file in files_of(work, out).items():
        if ".tmp" in file.name:
            wrong.append(None if ended_at_once else f"{name} is left")
        elif not GROWING.search(name):
            wrong.append(undisturbed.differs(work, out, name, file))
    return [text for text in wrong if text]


def names_something(call, message, work):
    """Whether the one line says what has failed."""
    if call in ("memory", "map") and "out of memory" in message or call == "thread" and "thread" in message:
        return True
    return call not in ("memory", "thread") and re.match(r"raylift: \S+: |.*[\w./-]+(\.\w+|/)", message) is not None


def faults_of(raylift, shim, work, command, call, at, undisturbed):
    """(whether the call was reached, what is wrong)"""
    out = f"fault-{command.name}"
    shutil.rmtree(work / out, ignore_errors=True)
    command.prepare(work, out)
    line = command.line(out)
    code, stdout, stderr, count = run_with_fault(raylift, shim, work, line, call, at)
    # Without memory the program may have to end where it stands.
    ended_at_once = count is None and call in ("memory", "map") and code == NO_MEMORY
    if count is None and not ended_at_once:
        return True, [f"it ended with {code}: {stderr.strip()[-300:]}"]
    if not ended_at_once and count < (1 if isinstance(at, str) else at):
        return False, []
    wrong = []
    if code == 0:
        gap = WITH_GAPS.get((command.name, call), "none ")
        wrong += [text for text in undisturbed.differences(work, out) if not text.startswith(gap)]
        if stdout.replace(out, "OUT") != undisturbed.stdout:
            wrong.append("it said something else: " + stdout[-200:])
    else:
        lines = [text for text in stderr.splitlines() if text]
        if code not in CODES[call]:
            wrong.append(f"exit code {code}: {stderr.strip()}")
        if not lines or not lines[-1].startswith("raylift: ") or not names_something(call, lines[-1], work):
            wrong.append(f"exit code {code} and the message {stderr!r}")
        wrong += left_behind(work, out, undisturbed, ended_at_once)
        again = subprocess.run([raylift, *command.line(out, again=True)], cwd=work, capture_output=True, text=True)
        if again.returncode != 0:
            wrong.append(f"run again, it ended with {again.returncode}: {again.stderr.strip()}")
        else:
            wrong += [f"run again, {text}" for text in undisturbed.differences(work, out)]
    return True, wrong


# ---- loss of power ----

class Disk:
    """What is left of files when the power fails, after the shim's journal: of each what was synced, and of each name
    that was given or changed since its folder was synced the one before."""

    def __init__(self, work, journal, before):
        self.bytes = {file: file.stat().st_size for file in before}
        self.pending = []  # (name, file that had it before or None)
        self.syncs = 0
        for line in journal.read_text().splitlines():
            what, name, more, kept = line.split("\t")
            file = work / name
            if what == "mkdir":
                self.pending.append((file, None))
            elif what == "rename":
                self.rename(file, work / more, pathlib.Path(kept) if kept else None)
            else:
                self.syncs += 1
                self.sync(file, int(more), what == "all")

    def rename(self, file, target, kept):
        self.pending.append((target, kept))
        if kept:
            self.bytes[kept] = self.bytes.get(target, 0)
        self.bytes[target] = self.bytes.pop(file, 0)

    def sync(self, file, size, whole_file_system):
        if whole_file_system:
            self.pending = []
            # Manifests may have grown since.
            whole = [other for other in self.bytes if not other.name.startswith("manifest")]
            self.bytes.update(dict.fromkeys(whole, math.inf))
        elif file.is_dir():
            self.pending = [(name, before) for name, before in self.pending if name.parent != file]
        else:
            self.bytes[file] = size

    def lose(self, out):
        for file, before in reversed(self.pending):
            if before is not None:
                self.bytes[file] = self.bytes[before]
                os.replace(before, file)
            elif file.is_dir():
                shutil.rmtree(file)
            else:
                file.unlink(missing_ok=True)
        for file in out.rglob("*"):
            if file.is_file() and self.bytes.get(file, 0) < file.stat().st_size:
                os.truncate(file, self.bytes.get(file, 0))


def power_loss_of(raylift, shim, work, command, at, undisturbed):
    """(how many syncs, renames and new folders there were: None where the power failed, syncs, what is wrong)"""
    out = f"power-{command.name}"
    shutil.rmtree(work / out, ignore_errors=True)
    for left in work.glob("journal*"):
        left.unlink()
    command.prepare(work, out)
    journal, before = work / "journal", [file for file in (work / out).rglob("*") if file.is_file()]
    code, _, stderr, count = run_with_fault(raylift, shim, work, command.line(out), "power", at, journal)
    if code not in (0, -9):
        return count, 0, [f"it ended with {code}: {stderr}"]
    disk = Disk(work, journal, before)
    disk.lose(work / out)
    wrong = []
    if (work / out / "o" / "manifest.jsonl").exists():
        done = subprocess.run([raylift, "verify", f"{out}/o", "--quiet"], cwd=work, capture_output=True, text=True)
        if done.returncode != 0:
            wrong.append(f"what the manifest promises is lost: {done.stdout}{done.stderr}")
    if code != 0:
        again = subprocess.run([raylift, *command.line(out, again=True)], cwd=work, capture_output=True, text=True)
        if again.returncode != 0:
            return count, disk.syncs, [*wrong, f"run again, it ended with {again.returncode}: {again.stderr.strip()}"]
    different = undisturbed.differences(work, out)
    return count, disk.syncs, wrong + [text for text in different if code == 0 or ".tmp" not in text]


def power_losses(raylift, shim, work, command, most, undisturbed):
    """(what was tried, what is wrong)"""
    count, syncs, found = power_loss_of(raylift, shim, work, command, 0, undisturbed)
    wrong = [f"power after the end: {text}" for text in found]
    chosen = points(1, count, most)
    for at in chosen:
        found = power_loss_of(raylift, shim, work, command, at, undisturbed)[2]
        wrong += [f"power {at} of {count}: {text}" for text in found]
    return f"power {len(chosen)}/{count} with {syncs} syncs", wrong


def points(first, count, most):
    """At most so many of first ... count, evenly spread."""
    total = count - first + 1
    if most == 0 or total <= most:
        return list(range(first, count + 1))
    return sorted({count - round(i * (total - 1) / max(most - 1, 1)) for i in range(most)})


def stacks_of(raylift, shim, work, line, call):
    """The names of the stacks that such calls come from."""
    kept = work / "stacks.txt"
    environment = dict(os.environ, LD_PRELOAD=str(shim), RAYLIFT_FAULT_CALL=call, RAYLIFT_FAULT_STACKS=str(kept))
    subprocess.run([raylift, *line], cwd=work, env=environment, capture_output=True)
    return set(kept.read_text().split())


def some(names, most):
    names = sorted(names)
    return names if most == 0 or len(names) <= most else sorted(random.Random(most).sample(names, most))


def new_parser():
    parser = argparse.ArgumentParser()
    parser.add_argument("raylift", type=pathlib.Path)
    parser.add_argument("shim", type=pathlib.Path)
    parser.add_argument("work", type=pathlib.Path)
    parser.add_argument("--points", type=int, default=3)
    return parser


def open_work(options):
    """The program, the shim and an empty folder; ends where the shim cannot work."""
    raylift, shim, work = options.raylift.resolve(), options.shim.resolve(), options.work.resolve()
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    if run_with_fault(raylift, shim, work, ["--version"], "memory", 0)[3] is None:
        print("the shim does not work with this C library")
        sys.exit(77)
    return raylift, shim, work


def main():
    parser = new_parser()
    parser.add_argument("--stacks", type=int)
    parser.add_argument("--command", action="append", choices=[command.name for command in COMMANDS])
    parser.add_argument("--call", action="append", choices=(*CALLS, "power"))
    parser.add_argument("--at", help="this one alone: a call's number or a stack's name")
    options = parser.parse_args()
    raylift, shim, work = open_work(options)
    make_inputs(raylift, work)
    start = run_with_fault(raylift, shim, work, ["status", "tum"], "memory", 0)[3]
    start_stacks = stacks_of(raylift, shim, work, ["status", "tum"], "memory")
    failures = 0
    for command in COMMANDS:
        if options.command and command.name not in options.command:
            continue
        undisturbed = Undisturbed(raylift, work, command)
        tried = []
        begin = time.monotonic()
        for call in options.call or (*CALLS, "power"):
            if call == "power":
                losses, wrong = power_losses(raylift, shim, work, command, options.points, undisturbed)
                tried.append(losses)
                failures += len(wrong)
                for text in wrong:
                    print(f"{command.name}, {text}", flush=True)
                continue
            out = f"count-{command.name}"
            shutil.rmtree(work / out, ignore_errors=True)
            command.prepare(work, out)
            count = run_with_fault(raylift, shim, work, command.line(out), call, 0)[3]
            # Most of the memory is asked for before the command begins: of that two points will do.
            first = min(start, count) if call == "memory" else 1
            chosen = [1, first // 2] if first > 1 else []
            chosen += points(first, count, options.points)
            if options.stacks is not None and call == "memory":
                shutil.rmtree(work / out)
                command.prepare(work, out)
                names = stacks_of(raylift, shim, work, command.line(out), call) - start_stacks
                chosen, count = some(names, options.stacks), len(names)
            if options.at:
                chosen = [int(options.at) if len(options.at) < 16 else options.at]
            reached = 0
            for at in chosen:
                was_reached, wrong = faults_of(raylift, shim, work, command, call, at, undisturbed)
                reached += was_reached
                for text in wrong:
                    failures += 1
                    print(f"{command.name}, {call} {at} of {count}: {text}", flush=True)
            tried.append(f"{call} {reached}/{count}")
        print(f"{command.name:10} {', '.join(tried)} ({time.monotonic() - begin:.0f} s)", flush=True)
    if failures:
        sys.exit(f"{failures} failures")


if __name__ == "__main__":
    main()
