"""PNG images of 8 and 16 bits a sample, not interlaced: read, changed and written by zlib alone."""

import itertools
import struct
import zlib

from benchmark_json import BadInput

SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}  # by colour type; palettes are not read


class Image:
    """rows: a bytes object each, samples of 16 bits as two bytes, the high one first."""

    def __init__(self, width, height, bits, color, rows):
        self.width, self.height, self.bits, self.color, self.rows = width, height, bits, color, rows

    @property
    def pixel_bytes(self):
        return CHANNELS[self.color] * self.bits // 8


def size_of(path):
    """Width and height, px, from the header alone."""
    try:
        with open(path, "rb") as file:
            head = file.read(24)
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}") from error
    if len(head) < 24 or not head.startswith(SIGNATURE):
        raise BadInput(f"{path}: not a PNG image")
    return struct.unpack(">II", head[16:24])


def read(path):
    size_of(path)
    with open(path, "rb") as file:
        data = file.read()
    position, packed, header = len(SIGNATURE), b"", None
    while position + 8 <= len(data):
        length, kind = struct.unpack(">I4s", data[position:position + 8])
        body = data[position + 8:position + 8 + length]
        if kind == b"IHDR":
            header = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            packed += body
        position += 12 + length
    width, height, bits, color, _, _, interlaced = header
    if bits not in (8, 16) or color not in CHANNELS or interlaced:
        raise BadInput(f"{path}: a PNG of a kind that is not read here")
    image = Image(width, height, bits, color, [])
    try:
        raw = zlib.decompress(packed)
    except zlib.error as error:
        raise BadInput(f"{path}: {error}") from error
    stride = 1 + width * image.pixel_bytes
    if len(raw) != stride * height:
        raise BadInput(f"{path}: {len(raw)} bytes of pixels, expected {stride * height}")
    above = bytes(stride - 1)
    for start in range(0, len(raw), stride):
        above = unfiltered(raw[start], raw[start + 1:start + stride], above, image.pixel_bytes)
        image.rows.append(above)
    return image


def unfiltered(kind, row, above, step):
    """A row without its filter (PNG specification, section 9)."""
    if kind == 0:
        return row
    if kind == 1:
        out = bytearray(len(row))
        for c in range(step):
            out[c::step] = bytes(itertools.accumulate(row[c::step], lambda a, b: (a + b) & 255))
        return bytes(out)
    if kind == 2:
        return bytes([(a + b) & 255 for a, b in zip(row, above)])
    out = bytearray(step) + bytearray(row)  # one pixel of zeros before the first
    above = bytes(step) + above
    if kind == 3:
        for i in range(step, len(out)):
            out[i] = (out[i] + ((out[i - step] + above[i]) >> 1)) & 255
        return bytes(out[step:])
    for i in range(step, len(out)):
        left, up, corner = out[i - step], above[i], above[i - step]
        to_left, to_up = abs(up - corner), abs(left - corner)
        to_corner = abs(left + up - 2 * corner)
        if to_left <= to_up and to_left <= to_corner:
            nearest = left
        else:
            nearest = up if to_up <= to_corner else corner
        out[i] = (out[i] + nearest) & 255
    return bytes(out[step:])


def write(path, image):
    def chunk(kind, body):
        return (struct.pack(">I", len(body)) + kind + body +
                struct.pack(">I", zlib.crc32(kind + body)))

    header = struct.pack(">IIBBBBB", image.width, image.height, image.bits, image.color, 0, 0, 0)
    pixels = zlib.compress(b"".join(b"\0" + row for row in image.rows), 1)
    with open(path, "wb") as file:
        file.write(SIGNATURE + chunk(b"IHDR", header) + chunk(b"IDAT", pixels))
        file.write(chunk(b"IEND", b""))


def brightened(image, factor):
    """All samples of an 8-bit image times a factor, saturated."""
    if image.bits != 8:
        raise BadInput("only images of 8 bits are brightened")
    table = bytes(min(255, round(factor * grey)) for grey in range(256))
    return Image(image.width, image.height, 8, image.color,
                 [row.translate(table) for row in image.rows])


def half_black(image):
    """The right half black."""
    left = (image.width // 2) * image.pixel_bytes
    return Image(image.width, image.height, image.bits, image.color,
                 [row[:left] + bytes(len(row) - left) for row in image.rows])


def resized(image, width, height):
    """The nearest pixel's values."""
    step = image.pixel_bytes
    columns = [step * (u * image.width // width) for u in range(width)]
    rows = []
    for v in range(height):
        source = v * image.height // height
        if v and source == (v - 1) * image.height // height:
            rows.append(rows[-1])
            continue
        row = image.rows[source]
        rows.append(b"".join([row[c:c + step] for c in columns]))
    return Image(width, height, image.bits, image.color, rows)


def samples(image, v):
    """The values of one row of a one-channel image."""
    row = image.rows[v]
    return row if image.bits == 8 else struct.unpack(f">{image.width}H", row)
