"""The server under many requests of several clients, a tenth of them hostile: soak_test.py RAYLIFT WORK_FOLDER
[--matches N] [--images N] [--clients N].

N requests hold matches in place of the image, N others photographs. All that is good must be answered, each time by
the same bytes as before; what is hostile must be refused (4xx), never by a fault of the server's (5xx); at the end
nothing must be held any more, and the server must end with 0 and without a word. Of more than 1,000 requests with
matches the resident memory stays, after those, within 5 % (not where RAYLIFT was built with a sanitizer).
"""

import argparse
import pathlib
import random
import shutil
import threading
import time

import served_room as room

HOSTILE_SHARE = 0.1
WARM_REQUESTS = 1000
MOST_GROWTH = 1.05


class Soak:
    """Requests that several threads send until so many are answered."""

    def __init__(self, server, good, count):
        self.server, self.good, self.count = server, good, count
        self.lock = threading.Lock()
        self.next = 0
        self.statuses = {}
        self.wrong = []
        self.resident = []  # (requests sent, bytes)
        connection = server.connect()
        self.expected = [room.post(connection, request) for request in good]
        connection.close()
        self.wrong += [f"a good request is answered {status}: {body}" for status, body in self.expected
                       if status != 200]

    def run(self, clients):
        threads = [threading.Thread(target=self.ask, args=(i,)) for i in range(clients)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def take(self):
        """Whether there is another to send."""
        with self.lock:
            if self.next == self.count:
                return False
            self.next += 1
            if self.next % (WARM_REQUESTS // 2) == 0:
                self.resident.append((self.next, self.server.resident_bytes()))
            return True

    def note(self, status, wrong=None):
        with self.lock:
            self.statuses[status] = self.statuses.get(status, 0) + 1
            if wrong:
                self.wrong.append(wrong)

    def ask(self, client):
        rng, connection = random.Random(client), self.server.connect()
        try:
            while self.take():
                which = rng.randrange(len(self.good))
                if rng.random() < HOSTILE_SHARE:
                    self.attack(room.hostile(rng, self.good[which]))
                else:
                    self.ask_well(connection, which)
        except Exception as error:  # a thread's ends there: the test must not take it for done
            self.note("lost", f"a request is lost: {error!r}")
        connection.close()

    def attack(self, attempt):
        status = room.attack(self.server.address, attempt)
        is_as_expected = status is None if attempt.expected is None else status in attempt.expected
        self.note(status, None if is_as_expected else f"{status} answers {attempt.sent[:300]}")

    def ask_well(self, connection, which):
        while True:
            found, expected = room.post(connection, self.good[which]), self.expected[which]
            is_well = found == expected or found[0] == 429
            self.note(found[0], None if is_well else f"{found}, but before {expected}"[:1000])
            if found[0] != 429:  # as too many batches are
                return
            time.sleep(0.01)

    def growth(self):
        """Of resident memory after the first requests; 1 where there were no more."""
        later = [size for sent, size in self.resident if sent >= WARM_REQUESTS]
        return max(later) / later[0] if later else 1.0


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("raylift", type=pathlib.Path)
    parser.add_argument("work", type=pathlib.Path)
    parser.add_argument("--matches", type=int, default=2000)
    parser.add_argument("--images", type=int, default=40)
    parser.add_argument("--clients", type=int, default=8)
    options = parser.parse_args()
    raylift, work = options.raylift.resolve(), options.work.resolve()
    shutil.rmtree(work, ignore_errors=True)
    room.make_room(raylift, work)
    wrong = []
    with room.RoomServer(raylift, work) as server:
        is_sanitized = "san.so" in pathlib.Path(f"/proc/{server.process.pid}/maps").read_text()
        for kind, good, count in (("matches", room.match_requests(work), options.matches),
                                  ("images", room.image_requests(work), options.images)):
            begin = time.monotonic()
            soak = Soak(server, good, count)
            soak.run(options.clients)
            wrong += soak.wrong
            told = f"{count} requests with {kind} in {time.monotonic() - begin:.0f} s: {soak.statuses}"
            if count > WARM_REQUESTS:
                told += (f", resident memory grows by {100 * (soak.growth() - 1):.1f} %"
                         f" of {soak.resident[1][1] >> 20} MiB")
                if kind == "matches" and not is_sanitized and soak.growth() > MOST_GROWTH:
                    wrong.append(f"resident memory: {soak.resident}")
            print(told, flush=True)
        wrong += room.wait_until_idle(server) if server.process.poll() is None else []
        wrong += room.wrong_at_the_end(server)
    room.conclude(wrong)


if __name__ == "__main__":
    main()
