"""What the server carries: bench_serve.py RAYLIFT [--seconds N] [--folder FOLDER] [--scene demo|rgbd_small]...
[-- OPTION...]

On the demo and on rgbd_small (in the folder RAYLIFT_TEST_DATA; else it is left out), over loopback, by clients of
this one process on the same cores:

- requests a second and percentiles of their times for 1, 2, 8 and 64 clients that send photographs one after the other;
- at twice the rate that 64 clients get, each request on a connection of its own: how long what is accepted takes
  beside that, how many are refused by 429, and that nothing else fails;
- how long one client's photographs take while others send batches one after the other, beside those of one client
  among as many others that send single ones: a batch is no way past them;
- the server's CPU time for each answer beside that of `localize` for each query, in pairs.

N (15) seconds are measured of each; further options (--max-features 1000) are those of `serve` and `localize`. Ratios
are of one run; "no" beside one says that it is not what it should be.
"""

import argparse
import collections
import http.client
import json
import os
import pathlib
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
CLIENTS = (1, 2, 8, 64)
MOST_P99_RATIO, MOST_CPU_RATIO = 2.0, 1.1
ROUNDS = 7  # of all queries, for CPU times


# ---- scenes ----

def scenes(folder):
    """(name, scene file, folder of photographs, {name: camera})"""
    demo = ROOT / "assets/demo"
    found = [("demo", demo / "scene.toml", demo / "images", demo / "queries.txt")]
    data = pathlib.Path(os.environ.get("RAYLIFT_TEST_DATA", "none")) / "rgbd_small"
    if data.exists():
        scene = folder / "rgbd_small.toml"
        scene.write_text(f'format = "raylift-scene/1"\nname = "rgbd_small"\nreferences = "{data / "model_ref"}"\n'
                         f'images = "{data / "images"}"\nqueries = "{data / "queries_with_intrinsics.txt"}"\n'
                         f'query_images = "{data / "images"}"\n'
                         f'[[geometry]]\nname = "mesh"\nspec = "mesh:{data / "mesh.ply"}"\n')
        found.append(("rgbd_small", scene, data / "images", data / "queries_with_intrinsics.txt"))
    else:
        print("rgbd_small is left out: it is not in the folder RAYLIFT_TEST_DATA")
    return [(name, scene, images, dict(line.split(" ", 1) for line in queries.read_text().splitlines()))
            for name, scene, images, queries in found]


def form(query, photographs):
    """`photographs` are (name, file)."""
    boundary = "raylift-bench-boundary"
    part = f'--{boundary}\r\nContent-Disposition: form-data; name='
    body = f'{part}"query"\r\n\r\n{json.dumps(query)}\r\n'.encode()
    for name, file in photographs:
        body += f'{part}"image"; filename="{name}"\r\n\r\n'.encode() + file.read_bytes() + b"\r\n"
    return body + f"--{boundary}--\r\n".encode(), {"Content-Type": f"multipart/form-data; boundary={boundary}"}


def request_of(name, camera, images):
    return form({"name": name, "camera": camera}, [("a.jpg", images / name)])


def batch_of(queries, images):
    """All that the first one's camera took."""
    camera = next(iter(queries.values()))
    return form({"camera": camera}, [(name, images / name) for name in queries if queries[name] == camera])


# ---- the server and its clients ----

class Server:
    def __init__(self, raylift, scene, calibration, cache, more):
        self.process = subprocess.Popen(
            [raylift, "serve", scene, "--port", "0", "--cache", cache, "--scene-calibration", calibration, *more],
            stdout=subprocess.PIPE, text=True)
        self.port = int(self.process.stdout.readline().rsplit(":", 1)[1])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait()
        self.process.stdout.close()

    def connect(self):
        return http.client.HTTPConnection("127.0.0.1", self.port, timeout=600)

    def cpu_seconds(self):
        words = pathlib.Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def ask(connection, request, path="/v1/localize"):
    """The status; 0 where none came."""
    body, headers = request
    try:
        try:
            connection.request("POST", path, body, headers)
        except ConnectionError:  # refused before the whole body was read
            pass
        answer = connection.getresponse()
        answer.read()
        return answer.status
    except (OSError, http.client.HTTPException):
        return 0


class Answers:
    """Of many threads: when each came, how long it took and its status."""

    def __init__(self):
        self.all = []  # lists take appends of several threads

    def add(self, begin, status):
        now = time.monotonic()
        self.all.append((now, now - begin, status))

    def between(self, begin, end):
        return [(seconds, status) for when, seconds, status in self.all if begin <= when < end]


def percentile_ms(seconds, percent):
    return 1e3 * sorted(seconds)[min(len(seconds) * percent // 100, len(seconds) - 1)]


def row(what, times, seconds, cpu_seconds=None):
    rate = len(times) / seconds
    print(f"{what:28}{rate:10.2f}" + "".join(f"{percentile_ms(times, p):10.0f}" for p in (50, 95, 99))
          + (f"{1e3 * cpu_seconds / len(times):10.0f}" if cpu_seconds else " " * 10) + f"{len(times):10}", flush=True)
    return rate, percentile_ms(times, 99)


def closed_loop(server, requests, clients, seconds):
    """Each client sends one when the one before is answered, or a second after it is refused; the time until all have
    been answered once is not counted."""
    answers, ends = Answers(), threading.Event()

    def client(index):
        connection = server.connect()
        while not ends.is_set():
            begin = time.monotonic()
            answers.add(begin, ask(connection, requests[index % len(requests)]))
            if answers.all[-1][2] == 429:
                ends.wait(1)
            index += 1
        connection.close()

    threads = [threading.Thread(target=client, args=(i,)) for i in range(clients)]
    for thread in threads:
        thread.start()
    while len(answers.all) < clients:  # until each has been answered once
        time.sleep(0.01)
    begin, cpu = time.monotonic(), server.cpu_seconds()
    time.sleep(seconds)
    cpu, end = server.cpu_seconds() - cpu, time.monotonic()
    ends.set()
    for thread in threads:
        thread.join()
    found = answers.between(begin, end)
    failed = collections.Counter(status for _, status in found if status != 200)
    return [taken for taken, status in found if status == 200], failed, end - begin, cpu


def beside_others(server, requests, sent, path, seconds):
    """The times of one client beside two others that send this one after the other."""
    ends = threading.Event()

    def other():
        connection = server.connect()
        while not ends.is_set():
            if ask(connection, sent, path) == 429:
                ends.wait(1)
        connection.close()

    others = [threading.Thread(target=other) for _ in range(2)]
    for thread in others:
        thread.start()
    times, _, measured, _ = closed_loop(server, requests, 1, seconds)
    ends.set()
    for thread in others:
        thread.join()
    return times, measured


def open_loop(server, requests, rate, seconds):
    """So many a second, whatever becomes of those before; what comes before the queue is full is not counted."""
    answers, threads = Answers(), []

    def client(request):
        begin, connection = time.monotonic(), server.connect()
        answers.add(begin, ask(connection, request))
        connection.close()

    start, measured = time.monotonic(), None
    while measured is None or time.monotonic() < measured + seconds:
        is_full = any(status == 429 for _, _, status in answers.all) or time.monotonic() > start + 4 * seconds
        if measured is None and is_full:
            measured = time.monotonic()
        threads.append(threading.Thread(target=client, args=(requests[len(threads) % len(requests)],)))
        threads[-1].start()
        time.sleep(max(start + len(threads) / rate - time.monotonic(), 0))
    end = time.monotonic()
    for thread in threads:
        thread.join()
    found = answers.between(measured, end)
    others = collections.Counter(status for _, _, status in answers.all if status not in (200, 429))
    return ([taken for taken, status in found if status == 200],
            [taken for taken, status in found if status == 429], others, end - measured)


# ---- the command line ----

def serve_cpu_s(server, requests):
    """Of the answers to two clients that share them."""
    left = list(requests)  # lists can be popped by several threads

    def client():
        connection = server.connect()
        while True:
            try:
                ask(connection, left.pop())
            except IndexError:
                return connection.close()

    cpu, threads = server.cpu_seconds(), [threading.Thread(target=client) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return server.cpu_seconds() - cpu


def localize_cpu_s(raylift, scene, lines, images, calibration, cache, work, more):
    """Of a run that extracts the features of its queries."""
    for folder in ("cache", "out"):
        shutil.rmtree(work / folder, ignore_errors=True)
    shutil.copytree(cache, work / "cache")
    (work / "queries.txt").write_text("".join(line + "\n" for line in lines))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([raylift, "localize", "--scene", scene, "--queries", work / "queries.txt", "--query-images", images,
                    "--scene-calibration", calibration, "--cache", work / "cache", "--no-doctor", "--quiet", "--out",
                    work / "out", *more], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def cpu_pairs_ms(server, raylift, scene, queries, images, calibration, cache, work, more):
    """(of an answer, of localize's query) by rounds of the same photographs under the same names, which the draws go
    by. A run of one query tells what a run costs by itself; that query is none of those that are compared."""
    pairs = []
    work.mkdir()
    for i in range(ROUNDS):
        (work / str(i)).symlink_to(images)
        named = {f"{i}/{name}": camera for name, camera in queries.items()}
        lines = [f"{name} {camera}" for name, camera in named.items()]
        run = [localize_cpu_s(raylift, scene, some, work, calibration, cache, work, more)
               for some in (lines[:1], lines)]
        served = serve_cpu_s(server, [request_of(name, camera, work) for name, camera in list(named.items())[1:]])
        pairs.append([1e3 * seconds / (len(queries) - 1) for seconds in (served, run[1] - run[0])])
    return pairs


def tell_cpu(pairs):
    ratios = sorted(served / local for served, local in pairs)
    served_ms, local_ms = (statistics.median(values) for values in zip(*pairs))
    print(f"CPU of an answer {served_ms:.0f} ms, of localize's query {local_ms:.0f} ms, medians of {ROUNDS} rounds;"
          f" ratio {judged(statistics.median(ratios), MOST_CPU_RATIO)}, from {ratios[0]:.2f} to {ratios[-1]:.2f}\n",
          flush=True)


def judged(ratio, most):
    return f"{ratio:.2f} ({'below' if ratio < most else 'no: not below'} {most})"


def measure(raylift, name, scene, images, queries, work, seconds, more):
    work.mkdir()
    calibration = work / "calibration.json"
    subprocess.run([raylift, "calibrate", "--scene", scene, "--cache", work / "cache", "--out", calibration, "--quiet",
                    *more], check=True)
    requests = [request_of(query, camera, images) for query, camera in queries.items()]
    print(f"{name:28}{'a second':>10}{'p50 ms':>10}{'p95 ms':>10}{'p99 ms':>10}{'CPU ms':>10}{'answers':>10}")
    with Server(raylift, scene, calibration, work / "cache", more) as server:
        for clients in CLIENTS:
            times, failed, measured, cpu = closed_loop(server, requests, clients, seconds)
            full_rate, full_p99 = row(f"{clients} clients", times, measured, cpu)
            if failed:
                print(f"  beside them, by status: {dict(failed)}")
        pairs = cpu_pairs_ms(server, raylift, scene, queries, images, calibration, work / "cache", work / "cpu", more)
        _, p99_single = row("1 beside 2 others", *beside_others(server, requests, requests[0], "/v1/localize", seconds))
        _, p99_batch = row("1 beside 2 batches", *beside_others(server, requests, batch_of(queries, images),
                                                                "/v1/localize/batch", seconds))
        accepted, refused, others, measured = open_loop(server, requests, 2 * full_rate, seconds)
        _, p99 = row("twice that: accepted", accepted, measured)
        row("twice that: refused (429)", refused, measured)
    print(f"p99 of what is accepted, beside 64 clients: {judged(p99 / full_p99, MOST_P99_RATIO)}")
    print(f"p99 of one beside batches, beside that beside single photographs: {p99_batch / p99_single:.2f}")
    print(f"failed but by 429: {f'no: {dict(others)}' if others else 'none'}")
    tell_cpu(pairs)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("raylift", type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=15)
    parser.add_argument("--folder", type=pathlib.Path, help="for what it makes (default: a temporary one)")
    parser.add_argument("--scene", action="append", choices=("demo", "rgbd_small"))
    given, more = sys.argv[1:], []
    if "--" in given:
        given, more = given[:given.index("--")], given[given.index("--") + 1:]
    options = parser.parse_args(given)
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        folder = pathlib.Path(folder)
        for name, scene, images, queries in scenes(folder):
            if not options.scene or name in options.scene:
                measure(options.raylift.resolve(), name, scene, images, queries, folder / name, options.seconds, more)


if __name__ == "__main__":
    main()
