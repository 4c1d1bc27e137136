"""A server of `raylift serve`, asked from Python by its standard library alone."""

from __future__ import annotations

import json
import os
import time
import urllib.error
import urllib.parse
import urllib.request
import uuid
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional, Sequence, Union, cast

from . import _core

if TYPE_CHECKING:
    from ._results import QueryLine, ServedScene
    from ._types import PathLike


class Client:
    """Localizes photographs in the scenes of a server (`raylift serve`).

    token: where the server asks for one. timeout: in seconds, of each request. patience: for how
    many seconds a request is sent again where the server is busy.
    """

    def __init__(self, url: str, *, token: Optional[str] = None, timeout: float = 60, patience: float = 60) -> None:
        if not isinstance(url, str):
            raise _core.InputTypeError(f"url: expected a str, found {type(url).__name__}")
        self._url = url.rstrip("/")
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._timeout = timeout
        self._patience = patience

    def scenes(self) -> List[ServedScene]:
        """What the server says of each of its scenes: its name, how many references it has."""
        return cast("List[ServedScene]", self._ask("/v1/scenes")["scenes"])

    def localize(self, image: Union[PathLike, bytes], *, name: Optional[str] = None,
                 camera: Union[str, _core.Camera, None] = None, priors: Union[str, Sequence[str], None] = None,
                 scene: Optional[str] = None, session: Optional[Mapping[str, object]] = None) -> QueryLine:
        """A photograph's line of queries.jsonl, as a dict: verdict, confidence, cam_from_world, counts.

        image: the photograph's file, or its bytes. name: its own by default. camera: "MODEL width
        height params..."; by default what EXIF says or an unknown focal length. priors: lines of a
        priors file. scene: may be left out where there is one. session: the photograph's place in a walk
        with odometry, a dict of cam_from_odometry (qvec and tvec), time_s and, but for the first, the token
        that the answer before has in its own `session`.

        Raises InputError where the server refuses the request, and ConnectionError where it cannot
        answer.
        """
        content = image if isinstance(image, bytes) else Path(image).read_bytes()
        if name is None:
            name = "photograph" if isinstance(image, bytes) else Path(image).name
        known = {"name": name, "camera": None if camera is None else str(camera),
                 "priors": priors if priors is None or isinstance(priors, str) else list(priors),
                 "session": None if session is None else dict(session)}
        query = json.dumps({key: value for key, value in known.items() if value is not None})
        boundary = uuid.uuid4().hex
        body = b"".join([
            f'--{boundary}\r\nContent-Disposition: form-data; name="query"\r\n\r\n{query}\r\n'.encode(),
            f'--{boundary}\r\nContent-Disposition: form-data; name="image"\r\n\r\n'.encode(), content,
            f"\r\n--{boundary}--\r\n".encode()])
        path = "/v1/localize"
        if scene is not None:
            path += "?scene=" + urllib.parse.quote(os.fspath(scene), safe="")
        form = {"Content-Type": f"multipart/form-data; boundary={boundary}"}
        return cast("QueryLine", self._ask(path, body, form))

    def _ask(self, path: str, body: Optional[bytes] = None, headers: Optional[Dict[str, str]] = None) -> Dict[str, Any]:
        request = urllib.request.Request(self._url + path, data=body, headers={**self._headers, **(headers or {})})
        give_up = time.monotonic() + self._patience
        while True:
            try:
                with urllib.request.urlopen(request, timeout=self._timeout) as answer:
                    found: Dict[str, Any] = json.load(answer)
                    return found
            except urllib.error.HTTPError as error:
                with error:
                    after = error.headers.get("Retry-After") or ""
                    wait = float(after) if after.isdigit() else 0.0
                    if not wait or time.monotonic() + wait > give_up:
                        raise _problem(error) from None
            except OSError as error:
                # A busy server closes what it does not read to its end.
                cause = getattr(error, "reason", error)
                wait = 1.0
                if not isinstance(cause, (ConnectionResetError, BrokenPipeError)) or time.monotonic() + wait > give_up:
                    raise ConnectionError(f"{self._url}: {cause}") from None
            time.sleep(wait)


def _problem(error: urllib.error.HTTPError) -> Exception:
    try:
        detail = str(json.load(error)["detail"])
    except (ValueError, KeyError):
        detail = str(error.reason)
    kind = _core.InputError if 400 <= error.code < 500 and error.code != 429 else ConnectionError
    return kind(detail)
