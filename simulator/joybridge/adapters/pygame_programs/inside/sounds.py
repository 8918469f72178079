"""Silent stand-ins for pygame.mixer and pygame.mixer_music, in virtual time.

The real ones play in a thread, which a fork does not have. Sounds here last as long as the real ones, as far as the
file tells: those of WAV files exactly, others as if they had 128 kbit/s.
"""

import io
import sys
import wave
from collections import Counter
from pathlib import Path
from types import ModuleType
from typing import Any

import pygame

from joybridge.adapters.pygame_programs.inside.clock import SECOND, VirtualClock, post

CHANNELS = 8  # as in pygame
FORMAT = (44100, -16, 2)
BYTES_PER_SECOND = 16_000  # of compressed files
ENDLESS = 1 << 62  # nanoseconds


class Sounds:
    """What is played, and what has been."""

    def __init__(self, clock: VirtualClock, played: Counter[str]) -> None:
        """Take the place of the mixer. played: counts the sounds that begin, by the name of the file."""
        self.clock, self._played = clock, played
        self.channels = [Channel(self) for _ in range(CHANNELS)]
        self.music = Music(self)
        self._install()
        clock.watchers.append(self._end_sounds)

    def note(self, name: str) -> None:
        """Count a sound that begins."""
        if name:
            self._played[name] += 1

    def find(self, force: bool = False) -> "Channel | None":
        """Return a channel that is free, as pygame.mixer.find_channel."""
        free = next((channel for channel in self.channels if not channel.get_busy()), None)
        return free or (min(self.channels, key=lambda channel: channel.ends) if force else None)

    def _end_sounds(self) -> None:
        for channel in (*self.channels, self.music):
            channel.end_if_over()

    def _install(self) -> None:
        sounds = self

        class Sound(_Sound):
            def play(self, loops: int = 0, maxtime: int = 0, fade_ms: int = 0) -> "Channel | None":
                channel = sounds.find()
                if channel is not None:
                    channel.play(self, loops, maxtime, fade_ms)
                return channel

            def stop(self) -> None:
                for channel in sounds.channels:
                    if channel.sound is self:
                        channel.stop()

            def fadeout(self, time: int) -> None:
                self.stop()

            def get_num_channels(self) -> int:
                return sum(channel.sound is self for channel in sounds.channels)

        mixer: Any = ModuleType("pygame.mixer", "A silent stand-in.")
        mixer.Sound, mixer.SoundType = Sound, Sound
        mixer.Channel, mixer.ChannelType = sounds._channel, Channel
        mixer.init = mixer.pre_init = mixer._internal_mod_init = mixer.quit = lambda *_, **__: None
        mixer.get_init = lambda: FORMAT
        mixer.get_num_channels = lambda: len(sounds.channels)
        mixer.set_num_channels, mixer.find_channel = sounds._set_count, sounds.find
        mixer.set_reserved = lambda count: count
        mixer.get_busy = lambda: any(channel.get_busy() for channel in sounds.channels)
        mixer.get_sdl_mixer_version = lambda linked=True: (2, 6, 0)
        for name in ("stop", "pause", "unpause", "fadeout"):
            setattr(mixer, name, lambda *arguments, name=name: sounds._all(name, *arguments))
        music: Any = ModuleType("pygame.mixer_music", "A silent stand-in.")
        for name in _MUSIC:
            setattr(music, name, getattr(sounds.music, name))
        mixer.music = music
        for name, module in (("mixer", mixer), ("mixer_music", music)):
            setattr(pygame, name, module)
            sys.modules[f"pygame.{name}"] = module
        sys.modules["pygame.mixer.music"] = music

    def _channel(self, number: int) -> "Channel":
        return self.channels[number]

    def _set_count(self, count: int) -> None:
        self.channels += [Channel(self) for _ in range(count - len(self.channels))]
        del self.channels[count:]

    def _all(self, name: str, *arguments: Any) -> None:
        for channel in self.channels:
            getattr(channel, name)(*arguments)


class Channel:
    """A channel of the mixer; `ends` is when its sound is over, in virtual nanoseconds."""

    def __init__(self, sounds: Sounds) -> None:
        self._sounds = sounds
        self.sound: Any = None
        self.ends = 0
        self._queued: Any = None
        self._left: int | None = None  # nanoseconds of a sound that is paused
        self._volume, self._end_event = 1.0, 0

    def play(self, Sound: Any, loops: int = 0, maxtime: int = 0, fade_ms: int = 0) -> None:  # noqa: N803
        """Begin a sound."""
        length = ENDLESS if loops < 0 else round(Sound.get_length() * (loops + 1) * SECOND)
        self.sound, self._left, self._queued = Sound, None, None
        self.ends = self._sounds.clock.now + (min(length, maxtime * 10**6) if maxtime > 0 else length)
        self._sounds.note(Sound.name)

    def end_if_over(self) -> None:
        """End the sound if its time is over, and begin the next."""
        if self.sound is not None and self._left is None and self._sounds.clock.now >= self.ends:
            queued = self._queued
            self.stop()
            if queued is not None:
                self.play(queued)

    def stop(self) -> None:
        """End the sound, and forget the queued one; its event is posted."""
        if self.sound is None:
            return
        self.sound = self._queued = None
        if self._end_event:
            post(pygame.event.Event(self._end_event))

    def fadeout(self, time: int) -> None:
        """End the sound, at once."""
        self.stop()

    def pause(self) -> None:
        """Hold the sound."""
        if self.sound is not None and self._left is None:
            self._left = self.ends - self._sounds.clock.now

    def unpause(self) -> None:
        """Go on with the sound."""
        if self._left is not None:
            self.ends, self._left = self._sounds.clock.now + self._left, None

    def queue(self, Sound: Any) -> None:  # noqa: N803
        """Begin a sound after the present one."""
        if self.sound is None:
            self.play(Sound)
        else:
            self._queued = Sound

    def get_busy(self) -> bool:
        """Return whether there is a sound."""
        return self.sound is not None

    def get_sound(self) -> Any:
        """Return the sound."""
        return self.sound

    def get_queue(self) -> Any:
        """Return the next sound."""
        return self._queued

    def set_volume(self, left: float, right: float = 1.0) -> None:
        """Set the volume."""
        self._volume = min(max(left, 0.0), 1.0)

    def get_volume(self) -> float:
        """Return the volume."""
        return self._volume

    def set_endevent(self, type: int = 0) -> None:
        """Post an event of this type at the end of each sound."""
        self._end_event = type

    def get_endevent(self) -> int:
        """Return the type of this event."""
        return self._end_event


_MUSIC = (
    "load", "unload", "play", "rewind", "stop", "pause", "unpause", "fadeout", "set_volume", "get_volume", "get_busy",
    "set_pos", "get_pos", "queue", "set_endevent", "get_endevent",
)  # fmt: skip


class Music(Channel):
    """The functions of pygame.mixer.music."""

    def __init__(self, sounds: Sounds) -> None:
        super().__init__(sounds)
        self._loaded: Any = None
        self._begun = 0

    def load(self, filename: Any, namehint: str = "") -> None:
        """Load a file."""
        self.stop()
        self._loaded = _Sound(filename)

    def unload(self) -> None:
        """Forget the file."""
        self._loaded = None

    def play(self, loops: Any = 0, start: float = 0.0, fade_ms: int = 0) -> None:  # type: ignore[override]
        """Begin the music."""
        sound = loops if isinstance(loops, _Sound) else self._loaded
        if sound is None:
            raise pygame.error("music not loaded")
        self._begun = self._sounds.clock.now
        super().play(sound, 0 if isinstance(loops, _Sound) else int(loops))
        self.ends -= round(start * SECOND)

    def queue(self, filename: Any, namehint: str = "", loops: int = 0) -> None:
        """Begin a file after the present one."""
        self._queued = _Sound(filename)

    def rewind(self) -> None:
        """Start over."""
        self._begun = self._sounds.clock.now

    def set_pos(self, pos: float) -> None:
        """Do nothing."""

    def get_busy(self) -> bool:
        """Return whether music plays; paused music does not."""
        return self.sound is not None and self._left is None

    def get_pos(self) -> int:
        """Return for how many milliseconds it has played, -1 if it does not."""
        return (self._sounds.clock.now - self._begun) // 10**6 if self.sound is not None else -1


class _Sound:
    """The name and the length of a sound."""

    _data: bytes

    def __init__(self, file: Any = None, buffer: Any = None, array: Any = None) -> None:
        self.name, self._volume = "", 1.0
        if isinstance(file, str | Path):
            self.name = Path(file).name
            self._data = Path(file).read_bytes()
        elif hasattr(file, "read"):
            self.name = Path(str(getattr(file, "name", ""))).name
            self._data = file.read()
        else:
            found: Any = next(one for one in (file, buffer, array, b"") if one is not None)
            self._data = found.tobytes() if hasattr(found, "tobytes") else bytes(memoryview(found))
        self._length = self._seconds(raw=not hasattr(file, "read") and not self.name)

    def _seconds(self, *, raw: bool) -> float:
        if raw:
            return len(self._data) / (FORMAT[0] * 2 * FORMAT[2])
        try:
            with wave.open(io.BytesIO(self._data)) as file:
                return float(file.getnframes() / file.getframerate())
        except (wave.Error, EOFError):
            return len(self._data) / BYTES_PER_SECOND

    def get_length(self) -> float:
        """Return the length in seconds."""
        return self._length

    def get_raw(self) -> bytes:
        """Return bytes of the sound's length."""
        return bytes(int(self._length * FORMAT[0]) * 2 * FORMAT[2])

    def set_volume(self, value: float) -> None:
        """Set the volume."""
        self._volume = min(max(value, 0.0), 1.0)

    def get_volume(self) -> float:
        """Return the volume."""
        return self._volume
