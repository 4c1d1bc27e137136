"""Photographs of a walk, localized while it is taken."""

from __future__ import annotations

import typing

from . import _core

if typing.TYPE_CHECKING:
    from typing_extensions import Unpack

    from . import _types


class Tracker:
    """The newest photograph of a walk by those before it and the odometry between them.

        tracker = raylift.Tracker(raylift.Localizer(scene))
        for photograph, pose, time in walk:
            tracked = tracker.add(photograph, camera, cam_from_odometry=pose, time=time)
            print(tracked.role, tracked.result.cam_from_world, tracked.world_from_odometry)

    What it costs and keeps is bounded, however long the walk is; the poses are those of
    `raylift localize --odometry --online`. odometry_scale: "known" where the odometry's unit is the
    scene's, else "unknown".
    """

    def __init__(self, localizer: _core.Localizer, *, odometry_scale: typing.Literal["known", "unknown"] = "known",
                 min_confidence: float = 0) -> None:
        if not isinstance(localizer, _core.Localizer):
            raise _core.InputTypeError(f"localizer: expected a raylift.Localizer, found {type(localizer).__name__}")
        self._localizer = localizer
        self._walk = _core.SceneTracker(localizer.scene, odometry_scale, min_confidence)

    def add(self, query: _types.PhotographLike | _core.LocalizedQuery, camera: _types.CameraLike | None = None, *,
            cam_from_odometry: _types.PoseLike, time: float, **priors: Unpack[_types.QueryOptions]) -> _core.TrackedPose:
        """The next photograph: as of Localizer.localize(), whose other arguments may be given, or the
        LocalizedQuery that it (or localize_matches()) returned. cam_from_odometry: the pose, world to
        camera, in the odometry's frame. time: in seconds.

        Raises InputError where the time does not grow."""
        if not isinstance(query, _core.LocalizedQuery):
            query = self._localizer.localize(query, camera, **priors)
        elif camera is not None or priors:
            raise TypeError("camera and priors belong to a photograph; the LocalizedQuery has its own")
        return self._walk.add(query, cam_from_odometry, time)
