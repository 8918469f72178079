"""A video file is whole or what it was before."""

import av
import numpy as np
import pytest

from joybridge.play.video import VideoFile

PICTURE = np.zeros((32, 48, 3), np.uint8)


def write(output, count, error=None):
    with VideoFile(output, 48, 32, 10) as video:
        for _ in range(count):
            video.write(PICTURE)
        if error:
            raise error


def frames(path):
    with av.open(str(path)) as video:
        return sum(1 for _ in video.decode(video=0))


@pytest.mark.parametrize(("kind", "kept"), [(KeyboardInterrupt, 3), (RuntimeError, 5)])
def test_an_interrupt_completes_the_video_and_an_error_leaves_the_one_before(tmp_path, kind, kept):
    output = tmp_path / "play.mp4"
    write(output, 5)
    assert frames(output) == 5
    with pytest.raises(kind):
        write(output, 3, kind)
    assert frames(output) == kept and list(tmp_path.iterdir()) == [output]
