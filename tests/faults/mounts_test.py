"""File systems that fail: mounts_test.py RAYLIFT WORK_FOLDER [--runs N]

Each command with its outputs on a file system that is read-only and on one that is full ends with an exit code
of its own and a line that names what cannot be written, leaves nothing half written, and ends with the results
of an undisturbed run once there is room. Inputs that are read-only do. N times (3) two shards write to one folder
at once, one of them by a second path to it, and are one run.

Makes its own file systems in a mount namespace of its own: needs root or user namespaces, else exit code 77.
"""

import argparse
import os
import pathlib
import shutil
import subprocess
import sys

import faults_test as faults

BAD_OUTPUT = faults.BAD_OUTPUT


def enter_namespace():
    """Runs this program again where it may mount."""
    if os.environ.get("RAYLIFT_TEST_MOUNTS"):
        return
    environment = dict(os.environ, RAYLIFT_TEST_MOUNTS="1")
    for unshare in (["unshare", "--mount"], ["unshare", "--mount", "--map-root-user"]):
        try:
            may = subprocess.run([*unshare, "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True).returncode == 0
        except FileNotFoundError:
            may = False
        if may:
            sys.exit(subprocess.run([*unshare, sys.executable, *sys.argv], env=environment).returncode)
    print("nothing can be mounted here")
    sys.exit(77)


def mount(*arguments):
    subprocess.run(["mount", *arguments], check=True)


def run(raylift, work, line):
    return subprocess.run([raylift, *line], cwd=work, capture_output=True, text=True)


def bad_end(done):
    """What is wrong with the end of a command that cannot write."""
    lines = done.stderr.splitlines()
    wrong = [] if done.returncode == BAD_OUTPUT else [f"exit code {done.returncode}: {done.stderr.strip()}"]
    if not lines or not lines[-1].startswith("raylift: ") or "/" not in lines[-1]:
        wrong.append(f"the message {done.stderr!r}")
    return wrong


def on_full_disk(raylift, work, command, undisturbed, free_kib):
    """(whether it did not fit, what goes wrong) where there is room for so much"""
    out = f"full{free_kib}-{command.name}"
    command.prepare(work, out)
    copied = sum(file.stat().st_size for file in faults.files_of(work, out).values()) // 1024
    kept = work / "kept"
    shutil.copytree(work / out, kept)
    # A tmpfs counts whole pages, one for each file and folder.
    pages = sum(1 for _ in kept.rglob("*"))
    mount("-t", "tmpfs", "-o", f"size={copied + 8 * pages + free_kib}k", "none", str(work / out))
    shutil.copytree(kept, work / out, dirs_exist_ok=True)
    shutil.rmtree(kept)
    done = run(raylift, work, command.line(out))
    wrong, is_full = [], done.returncode != 0
    if is_full:
        wrong += bad_end(done) + faults.left_behind(work, out, undisturbed, False)
        mount("-o", "remount,size=1g", str(work / out))
        done = run(raylift, work, command.line(out, again=True))
    if done.returncode != 0:
        wrong.append(f"with room again, it ended with {done.returncode}: {done.stderr.strip()}")
    else:
        wrong += undisturbed.differences(work, out)
    subprocess.run(["umount", str(work / out)], check=True)
    return is_full, wrong


def on_read_only(raylift, work, command):
    out = f"fixed-{command.name}"
    command.prepare(work, out)
    mount("--bind", str(work / out), str(work / out))
    mount("-o", "remount,bind,ro", str(work / out))
    wrong = bad_end(run(raylift, work, command.line(out)))
    subprocess.run(["umount", str(work / out)], check=True)
    return wrong


def from_read_only(raylift, work, command, undisturbed):
    """Inputs that cannot be written to; outputs are elsewhere."""
    out = f"beside-{command.name}"
    (work / out).mkdir()
    mount("--bind", str(work), str(work))
    mount("-t", "tmpfs", "none", str(work / out))
    for source in command.copies:
        shutil.copytree(work / source, work / out / source)
    mount("-o", "remount,bind,ro", str(work))
    done = run(raylift, work, command.line(out))
    wrong = [] if done.returncode == 0 else [f"it ended with {done.returncode}: {done.stderr.strip()}"]
    wrong += undisturbed.differences(work, out)
    subprocess.run(["umount", str(work / out)], check=True)
    subprocess.run(["umount", str(work)], check=True)
    (work / out).rmdir()
    return wrong


def shards_by_two_paths(raylift, work, whole):
    """What differs from the whole where two shards have one folder, each by a path of its own."""
    for name in ("shared", "second"):
        shutil.rmtree(work / name, ignore_errors=True)
        (work / name).mkdir()
    mount("--bind", str(work / "shared"), str(work / "second"))
    shards = [subprocess.Popen([raylift, *faults.LOCALIZE, "--out", name, "--shard", f"{i}/2"], cwd=work,
                               stderr=subprocess.PIPE, text=True)
              for i, name in enumerate(("shared", "second"))]
    wrong = [f"shard {i} ended with {shard.returncode}: {message.strip()}"
             for i, shard in enumerate(shards) for message in [shard.communicate()[1]] if shard.returncode != 0]
    subprocess.run(["umount", str(work / "second")], check=True)
    for line in (["status", "shared"], ["merge", "shared"]):
        done = run(raylift, work, line)
        if done.returncode != 0:
            wrong.append(f"{line[0]} ended with {done.returncode}: {done.stderr.strip()}")
    for name in ("poses.txt", "queries.jsonl"):
        merged = work / "shared" / name
        if not merged.exists() or faults.contents(merged, "shared") != faults.contents(work / whole / name, whole):
            wrong.append(f"{name} is another")
    return wrong


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("raylift", type=pathlib.Path)
    parser.add_argument("work", type=pathlib.Path)
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    raylift, work = options.raylift.resolve(), options.work.resolve()
    enter_namespace()
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    faults.make_inputs(raylift, work)
    failures = 0

    def tell(name, wrong):
        nonlocal failures
        failures += len(wrong)
        for text in wrong:
            print(f"{name}: {text}", flush=True)

    for command in faults.COMMANDS:
        if not any("OUT" in argument for argument in command.arguments):
            continue
        undisturbed = faults.Undisturbed(raylift, work, command)
        tell(f"{command.name}, read-only", on_read_only(raylift, work, command))
        tell(f"{command.name}, read-only inputs", from_read_only(raylift, work, command, undisturbed))
        full = []
        for free_kib in (4, 16, 64, 256):
            is_full, wrong = on_full_disk(raylift, work, command, undisturbed, free_kib)
            tell(f"{command.name}, a disk with {free_kib} KiB", wrong)
            full += [str(free_kib)] * is_full
        print(f"{command.name:10} has too little with {', '.join(full) or 'none'} KiB", flush=True)
    for i in range(options.runs):
        tell(f"two shards by two paths, run {i}", shards_by_two_paths(raylift, work, "run"))
    if failures:
        sys.exit(f"{failures} failures")


if __name__ == "__main__":
    main()
