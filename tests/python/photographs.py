"""Photographs that say where they were taken."""

import struct


def jpeg(
        latitude: float, longitude: float, altitude: float | None = None,
        direction: float | None = None, magnetic: bool = False, error: float | None = None,
        xmp: str | None = None) -> bytes:
    """The header of a photograph: EXIF with a GPS directory, and XMP."""
    data, entries = b"", []
    # Two directories with one and up to nine entries, then what does not fit into them.
    at = 8 + 2 + 12 + 4

    def rational(*values: float) -> bytes:
        return b"".join(struct.pack("<II", round(v * 1e7), 10**7) for v in values)

    def sides(value: float) -> bytes:
        degrees = int(abs(value))
        minutes = int((abs(value) - degrees) * 60)
        return rational(degrees, minutes, ((abs(value) - degrees) * 60 - minutes) * 60)

    wanted = [(1, 2, 2, b"N\0" if latitude >= 0 else b"S\0"), (2, 5, 3, sides(latitude)),
              (3, 2, 2, b"E\0" if longitude >= 0 else b"W\0"), (4, 5, 3, sides(longitude))]
    if altitude is not None:
        wanted += [(5, 1, 1, b"\1" if altitude < 0 else b"\0"), (6, 5, 1, rational(abs(altitude)))]
    if direction is not None:
        wanted += [(16, 2, 2, b"M\0" if magnetic else b"T\0"), (17, 5, 1, rational(direction))]
    if error is not None:
        wanted += [(31, 5, 1, rational(error))]
    values_at = at + 2 + 12 * len(wanted) + 4
    for tag, kind, count, value in wanted:
        if len(value) <= 4:
            entries.append(struct.pack("<HHI", tag, kind, count) + value.ljust(4, b"\0"))
        else:
            entries.append(struct.pack("<HHII", tag, kind, count, values_at + len(data)))
            data += value
    tiff = struct.pack("<2sHIHHHIII", b"II", 42, 8, 1, 0x8825, 4, 1, at, 0)
    tiff += struct.pack("<H", len(entries)) + b"".join(entries) + struct.pack("<I", 0) + data
    segments = [b"Exif\0\0" + tiff]
    if xmp:
        segments.append(b"http://ns.adobe.com/xap/1.0/\0" + xmp.encode())
    frame = bytes.fromhex("ffc0000b080c0010000101") + b"\x11\0"  # 4096 x 3072
    marked = (b"\xff\xe1" + struct.pack(">H", len(s) + 2) + s for s in segments)
    return b"\xff\xd8" + b"".join(marked) + frame
