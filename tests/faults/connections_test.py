"""The server while thousands of connections are held open: connections_test.py RAYLIFT WORK_FOLDER [--connections N].

N of them ask nothing, have sent a part of a header or of a body, or are without a request after an answer. Twice: with
the server's bounds, where those that ask nothing or are about to end give way, and where all of them stay.
Meanwhile a client that keeps its connection and one that opens a new one for each request are answered as ever, and
the server's memory is bounded; at the end nothing is held any more.
"""

import argparse
import http.client
import pathlib
import resource
import shutil
import socket
import struct
import sys
import threading
import time

import served_room as room

SPARE = 500  # files beside the connections
DEFAULT_BOUND = 1000
MOST_BYTES = 32 << 10  # of a connection

HEAD = b"POST /v1/localize HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\n"
WITHOUT_A_REQUEST = (b"", b"P", HEAD, b"GET /healthz HTTP/1.1\r\nHost: a\r\n\r\n")
ABOUT_TO_END = b"GET /healthz HTTP/1.0\r\n\r\n"  # for 2 s, unless its place is asked for
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


def ask(connection, request):
    """The answer; what went wrong where there is none."""
    try:
        return room.post(connection, request)
    except (OSError, http.client.HTTPException) as error:
        connection.close()  # and is opened by the next request
        return repr(error)


class GoodClient(threading.Thread):
    """Asks until it is told to end, once more where its connection was cut: it was without a request for long."""

    def __init__(self, server, requests, expected, keeps_connection):
        super().__init__()
        self.server, self.requests, self.expected = server, requests, expected
        self.keeps_connection, self.ends = keeps_connection, threading.Event()
        self.wrong, self.slowest, self.asked, self.cuts = [], 0.0, 0, 0

    def run(self):
        connection = self.server.connect()
        while not self.ends.is_set() or self.asked == 0:
            which = self.asked % len(self.requests)
            begin = time.monotonic()
            found = ask(connection, self.requests[which])
            if isinstance(found, str):
                self.cuts += 1
                found = ask(connection, self.requests[which])
            self.slowest = max(self.slowest, time.monotonic() - begin)
            if found != self.expected[which]:
                self.wrong.append(f"beside the flood: {found}, but before {self.expected[which]}")
            self.asked += 1
            if not self.keeps_connection:
                connection.close()
        connection.close()


def flood(server, requests, count, beginnings):
    """What is wrong, and a text that tells what was seen."""
    connection = server.connect()
    expected = [ask(connection, request) for request in requests]
    connection.close()
    before, wrong = server.resident_bytes(), []
    held = Held(server.address)
    clients = [GoodClient(server, requests, expected, keeps_connection) for keeps_connection in (True, False)]
    for client in clients:
        client.start()
    for _ in range(count):
        held.open(beginnings)
    for client in clients:
        client.ends.set()
        client.join()
        wrong += client.wrong
    asked, cuts = sum(client.asked for client in clients), sum(client.cuts for client in clients)
    slowest = max(client.slowest for client in clients)
    open_now, grown = int(server.gauge("raylift_connections")) - 1, server.resident_bytes() - before
    held.close()
    told = (f"{count} connections, {open_now} of them open at the end: {asked} good requests answered, the slowest in"
            f" {1e3 * slowest:.0f} ms, {cuts} of them asked twice; memory grows by {grown / 2**20:.1f} MiB of"
            f" {before / 2**20:.0f}")
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
    for bound, beginnings in ((DEFAULT_BOUND, (*WITHOUT_A_REQUEST, ABOUT_TO_END)),
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
            wrong += room.wrong_at_the_end(server)
    room.conclude(wrong)


if __name__ == "__main__":
    main()
