"""Pictures in, a video out: .mp4 by the user's own ffmpeg, .gif by Pillow."""

from __future__ import annotations

import io
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from rbd.errors import PictureError
from rbd.visual.style import COM_COLOR, CONTACT_COLORS, GHOST_COLOR, PUSH_COLOR, SUPPORT_COLOR, WRENCH_COLOR, rgb

VIDEOS = (".mp4", ".gif")
# The first that this ffmpeg has; the last is in all of them.
CODECS = {
    "libx264": ("-preset", "veryfast", "-crf", "20"),
    "libopenh264": ("-b:v", "6M"),
    "h264_videotoolbox": ("-b:v", "6M"),
    "mpeg4": ("-q:v", "3"),
}
QUALITY = {".mp4": 0.95, ".gif": 1.0}
"""Of the JPEG pictures, from 0 to 1; at 1 their colours are not thinned out."""
MOST_GIF_FPS = 50.0
"""Viewers slow down what changes faster."""
ASK_SECONDS = 20.0
_COLORS = 255  # and one index for what has not changed
_VIVID, _VIVID_COLORS = 40, 60
_OTHER_COLORS = (PUSH_COLOR, COM_COLOR, GHOST_COLOR, SUPPORT_COLOR, WRENCH_COLOR)
Encoder = Callable[[BinaryIO, Iterable[bytes], Iterable[bytes]], None]
"""Is given an open file, the pictures (JPEG), and some of them from all over the video, from which a .gif takes its colours."""


def encoder_of(target: Path, fps: float, width: int, height: int) -> Encoder:
    """What writes pictures (JPEG, all of one size) to an open file as a video of the kind that the name's ending says.

    Args:
        target: Path of the video.
        fps: Pictures a second.
        width: Of a picture, in pixels.
        height: Of a picture, in pixels.

    Raises:
        PictureError: another ending, no ffmpeg for .mp4, no Pillow for .gif, or a size or rate that the kind has not.
    """
    kind = target.suffix.lower()
    if kind == ".mp4":
        if width % 2 or height % 2:
            raise PictureError(f"the size is {width} x {height}; expected even numbers of pixels for .mp4.")
        return _mp4(*_ffmpeg(), fps)
    if kind == ".gif":
        if fps > MOST_GIF_FPS:
            raise PictureError(f"fps is {fps:g}; expected at most {MOST_GIF_FPS:g} for .gif: viewers slow down what is faster.")
        try:
            import PIL  # noqa: F401
        except ImportError:
            raise PictureError("a .gif needs Pillow. Install the extra: pip install 'rbd-contact[plot]'") from None
        return _gif(fps, width, height)
    raise PictureError(f"cannot write the video {str(target)!r:.200}: expected a name that ends in {' or '.join(VIDEOS)}.")


def _ffmpeg() -> tuple[str, str]:
    """Path of ffmpeg, and the best codec it has."""
    if (path := shutil.which("ffmpeg")) is None:
        raise PictureError("no ffmpeg on PATH, which makes .mp4. Install ffmpeg, or give a name that ends in .gif.")
    asked = [path, "-hide_banner", "-encoders"]
    try:
        said = subprocess.run(asked, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=ASK_SECONDS, check=True)
    except (OSError, subprocess.SubprocessError) as error:
        raise PictureError(f"{path} does not run: {error}. Install ffmpeg anew, or give a name that ends in .gif.") from error
    words = set(said.stdout.split())
    if (codec := next((codec for codec in CODECS if codec in words), None)) is None:
        raise PictureError(f"{path} has none of the codecs {', '.join(CODECS)}. Give a name that ends in .gif.")
    return path, codec


def _mp4(ffmpeg: str, codec: str, fps: float) -> Encoder:
    def write(file: BinaryIO, frames: Iterable[bytes], samples: Iterable[bytes]) -> None:
        # JPEG has the colours of BT.601 over the full range; players expect BT.709 within theirs.
        colors = "scale=in_range=full:out_range=tv:in_color_matrix=bt601:out_color_matrix=bt709,format=yuv420p"
        tags = [part for name in ("colorspace", "color_primaries", "color_trc") for part in (f"-{name}", "bt709")]
        given = ["-f", "image2pipe", "-c:v", "mjpeg", "-framerate", f"{fps:.10g}", "-i", "pipe:0", "-an", "-vf", colors]
        made = ["-c:v", codec, *CODECS[codec], *tags, "-color_range", "tv", "-movflags", "+faststart", "-f", "mp4"]
        # The open file by its descriptor: its name stays the caller's affair.
        command = [ffmpeg, "-hide_banner", "-loglevel", "error", "-y", *given, *made, f"/dev/fd/{file.fileno()}"]
        with tempfile.TemporaryFile() as told:
            pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": told}
            # Ctrl-C in the terminal is for Python, which then ends it.
            running = subprocess.Popen(command, **pipes, pass_fds=(file.fileno(),), start_new_session=True)
            try:
                assert running.stdin is not None
                with suppress(BrokenPipeError):  # why it ended is said below
                    for frame in frames:
                        running.stdin.write(frame)
                with suppress(BrokenPipeError):
                    running.stdin.close()
                status = running.wait()
            except BaseException:
                running.kill()
                with suppress(OSError):
                    running.stdin.close()  # type: ignore[union-attr]
                running.wait()
                raise
            if status:
                told.seek(0)
                lines = told.read().decode(errors="replace").strip().splitlines()
                words = lines[-1][:300] if lines else "it said nothing"
                raise PictureError(f"ffmpeg made no video (exit {status}): {words}. A name that ends in .gif needs no ffmpeg.")

    return write


def _gif(fps: float, width: int, height: int) -> Encoder:
    def write(file: BinaryIO, frames: Iterable[bytes], samples: Iterable[bytes]) -> None:
        from PIL import Image

        palette = _palette([_opened(sample) for sample in samples])
        colors = bytes(palette.getpalette() or b"").ljust(3 * 256, b"\0")
        file.write(b"GIF89a" + _short(width) + _short(height) + b"\xf7\0\0" + colors)
        file.write(b"\x21\xff\x0bNETSCAPE2.0\x03\x01\0\0\0")  # the loop extension: repeat without end
        before: Any = None
        for i, frame in enumerate(frames):
            here = np.asarray(_opened(frame).quantize(palette=palette, dither=Image.Dither.NONE))
            ticks = round(100.0 * (i + 1) / fps) - round(100.0 * i / fps)  # hundredths of a second, in all as many as are due
            file.write(_gif_frame(here, before, ticks))
            before = here
        file.write(b";")

    return write


def _opened(picture: bytes) -> Any:
    from PIL import Image

    return Image.open(io.BytesIO(picture)).convert("RGB")


def _palette(samples: list[Any]) -> Any:
    """255 colours, as an image of Pillow's: those of forces lit and in shade, those of coloured places, those of the rest.

    By area alone an arrow would have no colour of its own.
    """
    from PIL import Image

    drawn = np.array([rgb(color) for color in (*CONTACT_COLORS, *_OTHER_COLORS)])
    white = [(1.0 - share) * drawn + share for share in (0.0, 0.45)]
    marks = (255.0 * np.vstack([*white, 0.75 * drawn, 0.5 * drawn])).round()
    pixels = np.concatenate([np.asarray(sample).reshape(-1, 3)[::3] for sample in samples])
    vivid = pixels[np.ptp(pixels, axis=1) > _VIVID]
    found = [marks]
    for some, n in ((vivid, _VIVID_COLORS), (pixels, _COLORS - len(marks) - _VIVID_COLORS)):
        if len(some):
            made = Image.fromarray(np.ascontiguousarray(some[None])).quantize(n, method=Image.Quantize.MEDIANCUT)
            found.append(np.reshape(made.getpalette() or [], (-1, 3)))
    image = Image.new("P", (1, 1))
    image.putpalette(np.vstack(found)[:_COLORS].astype(np.uint8).tobytes())
    return image


def _gif_frame(here: Any, before: Any, ticks: int) -> bytes:
    """A picture as indices of colours, shown for so many hundredths of a second.

    Of a picture with one before it: the rectangle that differs, and in it only what differs.
    """
    from PIL import GifImagePlugin, Image

    offset, told = (0, 0), {"duration": 10 * ticks, "disposal": 1}
    if before is not None:
        differs = here != before
        down, across = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
        # A picture that repeats the last one is a single pixel: it takes its time.
        (top, bottom), (left, right) = ((each[0], each[-1] + 1) if len(each) else (0, 1) for each in (down, across))
        here = np.where(differs, here, _COLORS)[top:bottom, left:right]
        offset, told["transparency"] = (int(left), int(top)), _COLORS
    image = Image.fromarray(np.ascontiguousarray(here, np.uint8))
    image.encoderconfig = (8, False)
    return b"".join(GifImagePlugin.getdata(image, offset, **told))


def _short(number: int) -> bytes:
    return int(number).to_bytes(2, "little")
