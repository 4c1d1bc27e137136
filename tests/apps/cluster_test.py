"""Runs that are shared by real schedulers: cluster_test.py SOURCE_FOLDER RAYLIFT WORK_FOLDER

Starts a Slurm of its own on this machine (slurmctld, slurmd and munge on the loopback interface), and
uses mpirun and snakemake; what is not installed is skipped with a message, and the exit code is 77 where
nothing is. However a run is launched, all its tasks are done, each once, and what it leaves are the
bytes of one run that was not shared. The files of assets/cluster are used as they are.
"""

import contextlib
import json
import os
import pathlib
import re
import shutil
import socket
import subprocess
import sys
import time

SKIPPED = 77
SOURCE, RAYLIFT, WORK = (pathlib.Path(a).resolve() for a in sys.argv[1:4])
DEMO = SOURCE / "assets/demo"
CLUSTER = SOURCE / "assets/cluster"
ENVIRONMENT = dict(os.environ, PATH=f"{RAYLIFT.parent}:/usr/sbin:{os.environ['PATH']}",
                   OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1",
                   OMPI_MCA_rmaps_base_oversubscribe="1", OMPI_MCA_btl_base_warn_component_unused="0")
# Of a job of Slurm that this test may run in.
for variable in [name for name in ENVIRONMENT if name.startswith(("SLURM_", "PMI", "OMPI_COMM"))]:
    del ENVIRONMENT[variable]

RENDER = ["raylift", "render", "--model", DEMO / "model", "--geometry", f"mesh:{DEMO / 'scene.obj'}",
          "--size", "64x48", "--threads", "1"]
LOCALIZE = ["localize", "--model", DEMO / "model", "--images", DEMO / "images", "--geometry",
            f"mesh:{DEMO / 'scene.obj'}", "--queries", DEMO / "queries.txt", "--every", "4",
            "--max-features", "500", "--cache", WORK / "cache"]


def run(command, expected=0, **options):
    result = subprocess.run([str(word) for word in command], env=options.pop("env", ENVIRONMENT), text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=300, **options)
    if expected is not None and result.returncode != expected:
        sys.exit(f"{' '.join(map(str, command))}\nexit code {result.returncode} instead of {expected}:\n"
                 f"{result.stdout}")
    return result.stdout


def text_of(command):
    return " ".join(str(word) for word in command)


def contents(folder, names=None):
    """The files of a run, without what it measures of its own time."""
    found = {}
    for file in sorted(folder.rglob("*")):
        name = str(file.relative_to(folder))
        if file.is_file() and name not in ("summary.json", "timing.jsonl") and (names is None or name in names):
            found[name] = file.read_bytes()
    return found


class Tasks:
    """Runs of `render`, each in a folder of its own, that must be the run that was not shared."""

    def __init__(self):
        run(RENDER + ["--out", WORK / "whole"])
        self.whole = contents(WORK / "whole")
        self.count = json.loads((WORK / "whole/manifest.jsonl").read_text().splitlines()[0])["tasks"]

    def expect(self, name, output):
        if contents(WORK / name) != self.whole:
            sys.exit(f"{name}: other files than those of one run\n{output}")
        rendered = sum(map(int, re.findall(r"\((\d+) rendered", output)))
        if rendered != self.count:
            sys.exit(f"{name}: {rendered} images were rendered instead of {self.count}\n{output}")
        print(f"{name}: {self.count} images, each once, the same bytes", flush=True)


class Slurm:
    """A cluster of one machine, in a folder."""

    def __init__(self, folder):
        self.folder = folder
        self.processes = []
        self.environment = dict(ENVIRONMENT, SLURM_CONF=str(folder / "slurm.conf"))

    def __enter__(self):
        for name in ("state", "spool"):
            (self.folder / name).mkdir(parents=True)
        (self.folder / "key").write_bytes(os.urandom(1024))
        (self.folder / "key").chmod(0o600)
        version = run(["slurmctld", "-V"])
        disabled = int(re.search(r"(\d+)\.", version).group(1)) >= 24
        (self.folder / "cgroup.conf").write_text(
            f"CgroupPlugin={'disabled' if disabled else 'cgroup/v1' if self.has_cgroup_v1() else 'cgroup/v2'}\n")
        ports = [self.free_port() for _ in range(2)]
        (self.folder / "slurm.conf").write_text(f"""ClusterName=test
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthType=auth/munge
AuthInfo=socket={self.folder}/munge.socket
SlurmUser=root
SlurmdUser=root
StateSaveLocation={self.folder}/state
SlurmdSpoolDir={self.folder}/spool
SlurmctldPidFile={self.folder}/slurmctld.pid
SlurmdPidFile={self.folder}/slurmd.pid
SlurmctldLogFile={self.folder}/slurmctld.log
SlurmdLogFile={self.folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
ReturnToService=2
SchedulerParameters=batch_sched_delay=0,sched_interval=1,sched_min_interval=0
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdParameters=config_overrides
KillWait=20
NodeName=localhost NodeAddr=127.0.0.1 CPUs=4 State=UNKNOWN
PartitionName=all Nodes=localhost Default=YES MaxTime=INFINITE State=UP
""")
        self.start("munged", "--foreground", "--force", f"--key-file={self.folder}/key",
                   f"--socket={self.folder}/munge.socket", f"--pid-file={self.folder}/munge.pid",
                   f"--log-file={self.folder}/munge.log", f"--seed-file={self.folder}/munge.seed")
        self.wait_for(lambda: (self.folder / "munge.socket").exists(), "munged")
        self.start("slurmctld", "-D", "-c")
        self.start("slurmd", "-D", "-N", "localhost")
        self.wait_for(lambda: "idle" in run(["sinfo", "-h", "-o", "%t"], None, env=self.environment),
                      "a node that is idle")
        return self

    def __exit__(self, *_):
        for process in reversed(self.processes):
            process.terminate()
        for process in reversed(self.processes):
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(30)
            process.kill()

    @staticmethod
    def has_cgroup_v1():
        return " cgroup " in pathlib.Path("/proc/mounts").read_text()

    @staticmethod
    def free_port():
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            return found.getsockname()[1]

    def start(self, *command):
        with open(self.folder / f"{command[0]}.out", "w") as output:
            self.processes.append(subprocess.Popen(command, env=self.environment, stdout=output,
                                                   stderr=subprocess.STDOUT))

    def wait_for(self, is_there, what, seconds=120):
        end = time.monotonic() + seconds
        while not is_there():
            if time.monotonic() > end:
                logs = "".join(log.read_text()[-2000:] for log in self.folder.glob("slurm*.log"))
                sys.exit(f"waited in vain for {what}\n{logs}")
            time.sleep(0.2)

    def submit(self, *words, **environment):
        """The id of a job of a script of its own, or of `--wrap`."""
        command = ["sbatch", "--parsable", f"--chdir={self.folder}", *map(str, words)]
        return run(command, env=dict(self.environment, **environment)).split(";")[0].strip()

    def state(self, job):
        return run(["squeue", "-h", "-r", "-j", job, "-o", "%t"], None, env=self.environment).split()

    def wait(self, job):
        """Until it has ended."""
        def ended():
            text = run(["scontrol", "-o", "show", "job", job], None, env=self.environment)
            states = re.findall(r"JobState=(\w+)", text)
            return not set(states) & {"PENDING", "RUNNING", "COMPLETING", "CONFIGURING", "REQUEUED"}
        self.wait_for(ended, f"the end of job {job}")

    def launch(self, name, array, command, tasks=1):
        """What the jobs of an array print, one after the other, with their exit codes."""
        words = [f"--array={array}"] if array else []
        job = self.submit(*words, f"--ntasks={tasks}", f"--output={self.folder}/{name}-%a.log",
                          f"--wrap={command}; echo exit code $?")
        self.wait(job)
        logs = sorted(self.folder.glob(f"{name}-*.log"))
        return "".join(log.read_text() for log in logs)


def expect_refused(output, count, part):
    if output.count("exit code 2") != count or part not in output:
        sys.exit(f"expected {count} refusals with \"{part}\":\n{output}")
    print(f"refused: {part}", flush=True)


def test_slurm_launches(slurm, tasks):
    def render(name, shard="auto", srun=""):
        return f"{srun} {text_of(RENDER)} --out {WORK / name} --shard {shard}"

    # One process of a job of two tasks would be the only one.
    expect_refused(slurm.launch("no_srun", "", render("no_srun"), tasks=2), 1, "put srun before the command")
    # Steps, arrays, arrays of steps, arrays with steps between their indices.
    for name, array, srun, processes in [("srun", "", "srun -n2", 2), ("array", "0-2", "", 1),
                                         ("array_of_steps", "0-1", "srun -n2", 2),
                                         ("every_second", "1-7:2", "", 1)]:
        tasks.expect(name, slurm.launch(name, array, render(name, srun=srun), tasks=processes))
    # What is not evenly spaced, or alone, does not tell its place: auto/N does.
    expect_refused(slurm.launch("sparse", "1,5,9", render("sparse")), 3, "not evenly spaced")
    output = slurm.launch("sparse_of", "0,2,3", render("sparse_of", "auto/5"))
    output += slurm.launch("sparse_rest", "1,4", render("sparse_of", "auto/5"))
    tasks.expect("sparse_of", output)
    output = slurm.launch("some", "0,1,3", render("some", "auto/4"))
    expect_refused(slurm.launch("alone", "2", render("some")), 1, "submitted again")
    status = run(["raylift", "status", WORK / "some"], 4)
    if "--array=2 with --shard auto/4" not in status:
        sys.exit(f"status does not say what to submit again:\n{status}")
    tasks.expect("some", output + slurm.launch("resubmitted", "2", render("some", "auto/4")))


def test_slurm_scripts(slurm):
    """array.sbatch and merge.sbatch, whose jobs are told to stop and are put in the queue again."""
    out = WORK / "localized"
    slow = ["--min-iterations", "20000", "--max-iterations", "20000"]
    run(["raylift", *LOCALIZE, *slow, "--threads", "2", "--out", WORK / "localized_whole"])
    job = slurm.submit("--array=0-2", CLUSTER / "array.sbatch", *LOCALIZE, *slow, "--out", out,
                       RAYLIFT_SHARDS="3")
    merge = slurm.submit(f"--dependency=afterany:{job}", CLUSTER / "merge.sbatch", out)
    slurm.wait_for(lambda: any('"name"' in file.read_text() for file in out.glob("manifest.*")),
                   "a first query")
    # What --signal=TERM@60 does at a minute before the end.
    run(["scancel", "--signal=TERM", f"{job}_0"], env=slurm.environment)
    run(["scontrol", "requeue", f"{job}_1"], None, env=slurm.environment)

    waiting_since = {}

    def ended():
        # Slurm waits for two minutes before it starts a job again; a few seconds are enough, for the
        # node to be rid of it.
        for task in range(3):
            if slurm.state(f"{job}_{task}") != ["PD"]:
                waiting_since.pop(task, None)
            elif time.monotonic() - waiting_since.setdefault(task, time.monotonic()) > 10:
                run(["scontrol", "update", f"JobId={job}_{task}", "StartTime=now"], None,
                    env=slurm.environment)
        return not slurm.state(merge)
    slurm.wait_for(ended, "the merge", 240)
    logs = "".join(log.read_text() for log in slurm.folder.glob("raylift-*.log"))
    if "stopped by a signal" not in logs or "done: 12 of 12" not in logs:
        sys.exit(f"not stopped, or not complete:\n{logs}")
    if contents(out, {"poses.txt"}) != contents(WORK / "localized_whole", {"poses.txt"}):
        sys.exit("array.sbatch: other poses than those of one run")
    print("array.sbatch, merge.sbatch: stopped, put in the queue again, the same bytes", flush=True)


def test_mpi(tasks):
    output = run([CLUSTER / "mpirun.sh", "4", *RENDER[1:-2], "--out", WORK / "mpirun"])
    tasks.expect("mpirun", output)


def test_mpi_in_slurm(slurm, tasks):
    command = f"mpirun -np 3 {text_of(RENDER)} --out {WORK / 'mpirun_in_slurm'} --shard auto"
    tasks.expect("mpirun_in_slurm", slurm.launch("mpirun_in_slurm", "", command, tasks=3))


def test_indexed_job():
    """The pods' command, by the indices that Kubernetes gives them."""
    try:
        import yaml
    except ImportError:
        return skip("indexed-job.yaml", "Python's yaml")
    job = yaml.safe_load((CLUSTER / "indexed-job.yaml").read_text())["spec"]
    command = job["template"]["spec"]["containers"][0]["command"]
    data = WORK / "data"
    data.mkdir()
    for file in DEMO.iterdir():
        (data / file.name).symlink_to(file)
    for index in range(job["completions"]):
        run([word.replace("/data", str(data)) for word in command] + LOCALIZE[-6:],
            env=dict(ENVIRONMENT, JOB_COMPLETION_INDEX=str(index)))
    run(["raylift", "localize", "--scene", data / "scene.toml", "--out", data / "whole", *LOCALIZE[-6:]])
    if contents(data / "result", {"poses.txt"}) != contents(data / "whole", {"poses.txt"}):
        sys.exit("indexed-job.yaml: other poses than those of one run")
    print("indexed-job.yaml: the same bytes", flush=True)


def test_snakefile():
    out = WORK / "snakemake"
    out.mkdir()
    run(["snakemake", "--snakefile", CLUSTER / "Snakefile", "--cores", "2", "--config",
         f"scene={DEMO / 'scene.toml'}", f"out={out}", "shards=3"], cwd=out)
    run(["raylift", "localize", "--scene", DEMO / "scene.toml", "--out", WORK / "snakemake_whole"])
    if contents(out, {"poses.txt"}) != contents(WORK / "snakemake_whole", {"poses.txt"}):
        sys.exit("Snakefile: other poses than those of one run")
    print("Snakefile: the same bytes", flush=True)


def test_recipes():
    """They build as the README's first command does."""
    command = re.search(r"^    (\S+\.sh)$", (SOURCE / "README.md").read_text(), re.MULTILINE).group(1)
    for name, step in [("Dockerfile", f"\nRUN {command}\n"), ("raylift.def", f"\n    {command}\n")]:
        if step not in (CLUSTER / name).read_text():
            sys.exit(f"{name} does not run {command}")


def skip(what, package):
    print(f"skipped: {what}, as {package} is not there", flush=True)


def main():
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    test_recipes()
    tasks = Tasks()
    has_slurm = all(shutil.which(name, path=ENVIRONMENT["PATH"]) for name in ("slurmctld", "slurmd", "munged"))
    has_mpi = shutil.which("mpirun") is not None
    if has_mpi:
        test_mpi(tasks)
    else:
        skip("mpirun.sh", "openmpi-bin")
    if has_slurm and os.geteuid() == 0:
        with Slurm(WORK / "slurm") as slurm:
            test_slurm_launches(slurm, tasks)
            if has_mpi:
                test_mpi_in_slurm(slurm, tasks)
            test_slurm_scripts(slurm)
    else:
        skip("array.sbatch", "slurm-wlm, or munge, or root")
    test_indexed_job()
    if shutil.which("snakemake"):
        test_snakefile()
    else:
        skip("Snakefile", "snakemake")
    return 0 if has_slurm or has_mpi else SKIPPED


if __name__ == "__main__":
    sys.exit(main())
