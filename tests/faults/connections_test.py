"""The server while thousands of connections are held open: connections_test.py RAYLIFT WORK_FOLDER [--connections N].

N of them ask nothing, have sent a part of a header or of a body, or are without a request after an answer. Twice: with
the server's bounds, where those that ask nothing give way, and where all of them stay. Meanwhile clients that ask well
are answered as ever, and the server's memory is bounded; at the end nothing is held any more.
"""

import argparse
import pathlib
import resource
import shutil
import socket
import struct
import sys
import time

import served_room as room

SPARE = 500  # files beside the connections
DEFAULT_BOUND = 1000
MOST_BYTES = 32 << 10  # of a connection
GOOD_EVERY = 500  # connections

HEAD = b"POST /v1/localize HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\n"
WITHOUT_A_REQUEST = (b"", b"P", HEAD, b"GET /healthz HTTP/1.1\r\nHost: a\r\n\r\n")
PART_OF_A_BODY = HEAD + b"Content-Length: 1000\r\n\r\n{\"matches\": ["


class Held:
    """Connections that are open."""

    def __init__(self, address):
        self.address, self.sockets = address, []

    def open(self, beginnings):
        connection = socket.create_connection(self.address, timeout=60)
        # Closed without a trace, so that its port is free again.
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.sockets.append(connection)
        try:
            connection.sendall(beginnings[len(self.sockets) % len(beginnings)])
        except ConnectionError:  # it had to give way
            pass

    def close(self):
        for connection in self.sockets:
            connection.close()


def ask(server, request):
    """The answer on a connection of its own; what went wrong where there is none."""
    connection = server.connect()
    try:
        return room.post(connection, request)
    except OSError as error:
        return repr(error)
    finally:
        connection.close()


def flood(server, requests, count, beginnings):
    """What is wrong, and a text that tells what was seen."""
    expected = [ask(server, request) for request in requests]
    before, wrong, slowest, asked = server.resident_bytes(), [], 0.0, 0
    held = Held(server.address)
    for i in range(count):
        held.open(beginnings)
        if (i + 1) % GOOD_EVERY == 0:
            begin = time.monotonic()
            found = ask(server, requests[asked % len(requests)])
            slowest = max(slowest, time.monotonic() - begin)
            if found != expected[asked % len(requests)]:
                wrong.append(f"beside {i + 1} connections: {found}, but before {expected[asked % len(requests)]}")
            asked += 1
    open_now, grown = int(server.gauge("raylift_connections")) - 1, server.resident_bytes() - before
    held.close()
    told = (f"{count} connections, {open_now} of them open at the end: {asked} good requests answered, the slowest in"
            f" {1e3 * slowest:.0f} ms; memory grows by {grown / 2**20:.1f} MiB of {before / 2**20:.0f}")
    if any(answer[0] != 200 for answer in expected):
        wrong.append(f"good requests are answered {expected}")
    return wrong, told, open_now, grown


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("raylift", type=pathlib.Path)
    parser.add_argument("work", type=pathlib.Path)
    parser.add_argument("--connections", type=int, default=10000)
    options = parser.parse_args()
    count = options.connections
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    if most < count + SPARE:
        print(f"skipped: {most} files may be open, not {count + SPARE}")
        sys.exit(77)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    raylift, work = options.raylift.resolve(), options.work.resolve()
    shutil.rmtree(work, ignore_errors=True)
    room.make_room(raylift, work)
    requests, wrong = room.match_requests(work, 4), []
    patient = ("--header-deadline", "600s", "--body-deadline", "600s")
    for bound, beginnings in ((DEFAULT_BOUND, WITHOUT_A_REQUEST),
                              (count + SPARE // 2, (*WITHOUT_A_REQUEST, PART_OF_A_BODY))):
        with room.RoomServer(raylift, work, *patient, "--max-connections", str(bound)) as server:
            found, told, open_now, grown = flood(server, requests, count, beginnings)
            print(told, flush=True)
            wrong += found
            most_open = min(count, bound - 1)
            if not 0.99 * most_open <= open_now <= most_open:
                wrong.append(f"{open_now} connections are open, of at most {bound}")
            if grown > open_now * MOST_BYTES:
                wrong.append(f"memory grows by {grown} bytes")
            wrong += room.wait_until_idle(server)
            code, said = server.end()
            if code != 0 or said:
                wrong.append(f"the server ended with {code}: {said}")
    for text in wrong[:20]:
        print(text)
    if wrong:
        sys.exit(f"{len(wrong)} failures")


if __name__ == "__main__":
    main()
