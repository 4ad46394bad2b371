"""Episodes side by side as one film, and its file: GIF, MP4, or PNG of the end."""

from __future__ import annotations

import itertools
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image as Pictures
from PIL import ImageDraw, ImageFont

from dashboards.play.episode import MAX_IMAGES, Episode, Image
from dashboards.play.gridworld import caption
from trainables.errors import InputError

SECONDS = 12.0
"""Approximate length of a film of many steps."""
FASTEST, SLOWEST = 25.0, 8.0
"""Images a second."""
REST = 1.5
"""Seconds for which the last image is shown."""
WIDTH, HEAD, GAP = 400, 40, 12
"""Pixels: the widest panel, the space for two lines above it, the space between two panels."""

SUFFIXES = (".gif", ".mp4", ".png")


def check_suffix(path: Path) -> None:
    """Raise InputError for a file name that no film can be written to."""
    if path.suffix not in SUFFIXES:
        raise InputError(f"a film is a .gif, an .mp4, or a .png of its end (got '{path}')")
    if path.suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(f"'{path}' needs ffmpeg, which is not installed: write a .gif")


def panels(episodes: Sequence[Episode]) -> Iterator[Image]:
    """Yield images of rendered episodes side by side, with their titles, the step and the return so far."""
    stride = max(episode.stride for episode in episodes)
    last = max(episode.steps for episode in episodes)
    for step in (*range(0, last, stride), last):
        yield _beside([_panel(episode, step) for episode in episodes])


def _panel(episode: Episode, step: int) -> Pictures.Image:
    picture = Pictures.fromarray(episode.image(step))
    if picture.width > WIDTH:
        picture = picture.resize((WIDTH, round(picture.height * WIDTH / picture.width)), Pictures.Resampling.LANCZOS)
    panel = Pictures.new("RGB", (max(picture.width, WIDTH), picture.height + HEAD), "white")
    panel.paste(picture, ((panel.width - picture.width) // 2, HEAD))
    pen = ImageDraw.Draw(panel)
    for line, text in enumerate((episode.title, caption(episode, step))):
        pen.text((panel.width / 2, 3 + 18 * line), text, "black", _font(), anchor="ma")
    return panel


def _font() -> ImageFont.FreeTypeFont:
    from matplotlib.font_manager import findfont

    return ImageFont.truetype(findfont("DejaVu Sans"), 13)


def _beside(each: Sequence[Pictures.Image]) -> Image:
    height = max(panel.height for panel in each)
    sheet = Pictures.new("RGB", (sum(panel.width for panel in each) + GAP * (len(each) - 1), height), "white")
    left = 0
    for panel in each:
        sheet.paste(panel, (left, 0))
        left += panel.width + GAP
    return np.asarray(sheet)


def write(images: Iterator[Image], path: Path) -> None:
    """Write a film in the format of the file's suffix. Raises InputError as `check_suffix` does."""
    check_suffix(path)
    every = list(images)
    if len(every) > MAX_IMAGES:
        every = [*every[: -1 : -(-len(every) // MAX_IMAGES)], every[-1]]
    if path.suffix == ".png":
        Pictures.fromarray(every[-1]).save(path)
        return
    rate = min(max(len(every) / SECONDS, SLOWEST), FASTEST)
    if path.suffix == ".mp4":
        _mp4([*every, *itertools.repeat(every[-1], round(REST * rate))], rate, path)
        return
    first, *rest = (Pictures.fromarray(image) for image in every)
    milliseconds = [round(1000 / rate)] * len(rest) + [round(1000 * REST)]
    first.save(path, "GIF", save_all=True, append_images=rest, duration=milliseconds, loop=0)


def _mp4(images: Sequence[Image], rate: float, path: Path) -> None:
    height, width = (side - side % 2 for side in images[0].shape[:2])  # an even number of pixels, as H.264 requires
    command = [
        *("ffmpeg", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"),
        *("-r", f"{rate:g}", "-i", "-", "-pix_fmt", "yuv420p", str(path)),
    ]
    data = b"".join(np.ascontiguousarray(image[:height, :width]).tobytes() for image in images)
    done = subprocess.run(command, input=data, capture_output=True, check=False)
    if done.returncode:
        raise InputError(f"ffmpeg cannot write '{path}': {done.stderr.decode(errors='replace').strip()}")
