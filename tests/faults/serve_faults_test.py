"""Makes one call of the server fail while it answers: serve_faults_test.py RAYLIFT SHIM WORK_FOLDER [--points N]
[--call NAME] [--at N].

As faults_test.py does of commands: allocations, reads, writes, new files, renames, mappings and threads, at N points each (3)
between the server's start and its end, evenly spread. Two clients send photographs and matches, among them what is
hostile, and SIGHUP opens the scene anew in between. Of what is good all must be answered as ever but for two requests,
which may be refused (5xx) or left without an answer; then the server must answer as ever, and end with 0 and nothing
held. Exit code 77 where the shim cannot work.
"""

import http.client
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time

import faults_test as faults
import served_room as room

CALLS = ("memory", "read", "write", "create", "rename", "map", "thread")
MOST_DISTURBED = 2
SECONDS_TO_END = 10


class Run:
    """One life of the server with one fault."""

    def __init__(self, raylift, work, shim, good, call, at):
        self.call, self.good, self.wrong, self.disturbed = call, good, [], 0
        self.report = work / "report.txt"
        self.report.unlink(missing_ok=True)
        shutil.rmtree(work / "kept", ignore_errors=True)
        (work / "kept").mkdir()
        environment = dict(os.environ, LD_PRELOAD=str(shim), RAYLIFT_FAULT_CALL=call, RAYLIFT_FAULT_AT=str(at),
                           RAYLIFT_FAULT_REPORT=str(self.report))
        self.server = room.RoomServer(raylift, work, "--cache", "cache", "--keep", "kept", "--scene-calibration",
                                      "calibration.json", environment=environment)

    def ask(self, which):
        """The answer; None where there was none."""
        connection = self.server.connect()
        try:
            return room.post(connection, self.good[which])
        except (OSError, http.client.HTTPException):
            return None
        finally:
            connection.close()

    def client(self, seed, expected):
        rng = random.Random(seed)
        for which in range(len(self.good)):
            found = self.ask(which)
            if found != expected[which]:
                self.disturbed += 1
                if found is not None and found[0] < 500:
                    self.wrong.append(f"{found}, but else {expected[which]}"[:1000])
            try:
                room.attack(self.server.address, room.hostile(rng, self.good[which]))
            except OSError:
                pass

    def answer(self, expected):
        clients = [threading.Thread(target=self.client, args=(seed, expected)) for seed in (1, 2)]
        for client in clients:
            client.start()
        self.server.process.send_signal(signal.SIGHUP)
        for client in clients:
            client.join()
        self.disturbed += sum(self.ask(which) != answer for which, answer in enumerate(expected))
        if self.disturbed > MOST_DISTURBED:
            self.wrong.append(f"{self.disturbed} requests are disturbed")
        for which, answer in enumerate(expected):
            if self.ask(which) != answer:
                self.wrong.append(f"afterwards request {which} is answered otherwise")

    def end(self):
        """How many such calls there were; None where it has not ended well."""
        self.server.process.send_signal(signal.SIGTERM)
        try:
            self.server.process.wait(timeout=SECONDS_TO_END)
        except subprocess.TimeoutExpired:  # the call that failed was the one that told of the signal
            self.wrong += ["it does not end"] if self.call not in ("read", "write") else []
        code, said = self.server.end()
        if code != 0:
            self.wrong.append(f"it ended with {code}: {said[-500:]}")
        if "Sanitizer" in said or "this is a bug" in said:
            self.wrong.append(said[-1000:])
        return int(self.report.read_text()) if self.report.exists() else None


def main():
    parser = faults.new_parser()
    parser.add_argument("--call", action="append", choices=CALLS)
    parser.add_argument("--at", type=int, help="this one alone")
    options = parser.parse_args()
    raylift, shim, work = faults.open_work(options)
    shutil.rmtree(work)
    room.make_room(raylift, work)
    faults.run_plain(raylift, work, ["calibrate", "--scene", "scene.toml", "--leave-one-out", "--max-features", "300",
                                     "--cache", "cache", "--out", "calibration.json", "--quiet"])
    good = room.match_requests(work, 4) + [request for request in room.image_requests(work)
                                           if request.path == "/v1/localize"]
    with room.RoomServer(raylift, work, "--cache", "cache", "--scene-calibration", "calibration.json") as server:
        expected = [room.post(server.connect(), request) for request in good]
    failures = 0
    for call in options.call or CALLS:
        begin, counts = time.monotonic(), []
        for answers in (False, True):
            run = Run(raylift, work, shim, good, call, 0)
            if answers:
                for client in (1, 2):
                    run.client(client, expected)
                run.server.process.send_signal(signal.SIGHUP)
            counts.append(run.end())
            if run.wrong:
                sys.exit(f"without a fault: {run.wrong[0]}")
        chosen = [options.at] if options.at else faults.points(counts[0] + 1, counts[1], options.points)
        for at in chosen:
            run = Run(raylift, work, shim, good, call, at)
            if run.server.address is None:
                run.wrong.append("it does not begin")
            else:
                run.answer(expected)
            run.end()
            failures += len(run.wrong)
            for text in run.wrong:
                print(f"{call} {at} of {counts[1]}: {text}", flush=True)
        print(f"{call:10} {len(chosen)} of {counts[1] - counts[0]} while it answers ({time.monotonic() - begin:.0f} s)",
              flush=True)
    if failures:
        sys.exit(f"{failures} failures")


if __name__ == "__main__":
    main()
