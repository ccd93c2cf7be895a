"""What a room, a microphone, a voice and a robot do to a word. All audio is float32[n] at 16 kHz in [-1, 1]."""

from __future__ import annotations

from typing import Sequence

import numpy as np
from scipy.signal import fftconvolve

import features
from features import HOP, RATE

# Six successive windows of the head end within half a second after the word: whichever is drawn, the word is in it.
SHIFTS = 6
SPAN = features.HEAD_SPAN + (SHIFTS - 1) * features.STEP
STEPS = features.WINDOWS + SHIFTS - 1

# Bands 4 to 27 of the log-mel, 0.33 to 2.9 kHz: where speech is loud and footsteps and hum are not.
SPEECH_BANDS = slice(4, 28)


def levels_db(mel: np.ndarray) -> np.ndarray:
    """float32[frames] of log-mel float32[frames, 32]: the mean over the speech bands, in decibels."""
    return (mel[:, SPEECH_BANDS].mean(axis=1) - 2) * 10


def extent(audio: np.ndarray) -> tuple[int, int]:
    """First and last sample of the word in a clip, its last consonant too: above the clip's floor, treble raised."""
    bright = np.diff(audio, prepend=audio[:1])
    blocks = bright[: len(bright) // HOP * HOP].reshape(-1, HOP)
    levels = 10 * np.log10(np.mean(blocks**2, axis=1) + 1e-12)
    levels = np.convolve(np.pad(levels, 1, "edge"), np.ones(3) / 3, "valid")
    floor, peak = np.percentile(levels, 10), levels.max()
    loud = np.flatnonzero(levels > max(peak - 35, min(floor + 9, peak - 6)))
    return int(loud[0]) * HOP, (int(loud[-1]) + 1) * HOP


def faster(audio: np.ndarray, factor: float) -> np.ndarray:
    """Played faster: shorter, and higher in pitch and formants."""
    return np.interp(np.arange(0, len(audio) - 1, factor), np.arange(len(audio)), audio).astype(np.float32)


def stretched(audio: np.ndarray, factor: float) -> np.ndarray:
    """Longer by a factor at the same pitch: pieces of 40 ms, each laid where it fits the one before (WSOLA)."""
    piece, hop, reach = 640, 320, 160
    if len(audio) < 3 * piece:
        return audio
    fade = np.hanning(piece + 1)[:piece].astype(np.float32)
    count = max(1, int((len(audio) * factor - piece) / hop))
    out = np.zeros(count * hop + piece, np.float32)
    padded = np.pad(audio, (reach, piece + hop + reach))
    last = 0
    for i in range(count):
        wanted = min(int(i * hop / factor), len(audio) - piece)
        if i:
            follow = padded[last + hop + reach : last + hop + reach + piece]
            around = padded[wanted : wanted + piece + 2 * reach]
            wanted += int(np.argmax(np.correlate(around, follow, "valid"))) - reach
            wanted = max(0, wanted)
        out[i * hop : i * hop + piece] += fade * padded[wanted + reach : wanted + reach + piece]
        last = wanted
    return out


def equalised(audio: np.ndarray, rng: np.random.Generator, spread_db: float) -> np.ndarray:
    """Another microphone and mouth: a smooth random response, sometimes a telephone's band."""
    spectrum = np.fft.rfft(audio)
    hz = np.arange(len(spectrum)) * RATE / len(audio)
    knots = np.log2([60, 150, 350, 800, 1600, 3000, 5000, 8000])
    gains = rng.normal(0, spread_db, len(knots)) + rng.normal(0, spread_db / 4) * np.arange(len(knots))
    response = np.interp(np.log2(np.maximum(hz, 1)), knots, gains)
    if rng.random() < 0.3:
        low, high = rng.uniform(50, 350), rng.uniform(2800, 7500)
        response -= 12 * np.maximum(0, np.log2(low / np.maximum(hz, 1))) + 24 * np.maximum(
            0, np.log2(np.maximum(hz, 1) / high)
        )
    return np.fft.irfft(spectrum * 10 ** (response / 20), len(audio)).astype(np.float32)


def shouted(audio: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """As if shouted: higher, brighter, clipped."""
    audio = faster(audio, rng.uniform(1.05, 1.2))
    spectrum = np.fft.rfft(audio)
    octaves = np.log2(np.maximum(np.arange(len(spectrum)) * RATE / len(audio), 100) / 1000)
    audio = np.fft.irfft(spectrum * 10 ** (np.clip(octaves, -2, 2) * rng.uniform(3, 7) / 20), len(audio))
    return clipped(audio.astype(np.float32), rng.uniform(2, 5))


def clipped(audio: np.ndarray, drive: float) -> np.ndarray:
    """Driven into saturation, its peak kept."""
    peak = max(float(np.abs(audio).max(initial=0)), 1e-6)
    return (np.tanh(audio / peak * drive) / np.tanh(drive) * peak).astype(np.float32)


def reverberated(audio: np.ndarray, rng: np.random.Generator, rt60_s: float, direct: float) -> np.ndarray:
    """In a room: echoes that fall by 60 dB in rt60_s; direct is the sound's own share of the energy."""
    t = np.arange(int(min(rt60_s, 0.6) * RATE)) / RATE
    tail = rng.standard_normal(len(t)) * 10 ** (-3 * t / rt60_s)
    tail[: int(rng.uniform(0.001, 0.01) * RATE)] = 0
    tail *= np.sqrt((1 - direct) / max(direct, 0.01) / np.sum(tail**2))
    wet = audio + fftconvolve(audio, tail)[: len(audio)]
    return (wet * np.abs(audio).max() / max(np.abs(wet).max(), 1e-9)).astype(np.float32)


def power(audio: np.ndarray) -> float:
    """Mean power of its louder half, as 20 ms blocks go."""
    blocks = (
        np.sort(np.mean(audio[: len(audio) // 320 * 320].reshape(-1, 320) ** 2, axis=1))
        if len(audio) >= 320
        else np.zeros(1)
    )
    return float(blocks[len(blocks) // 2 :].mean()) + 1e-12


class Scene:
    """Draws rooms, microphones and backgrounds; `noises` and `talk` are real recordings of the training side."""

    def __init__(self, noises: Sequence[np.ndarray], talk: Sequence[np.ndarray]) -> None:
        self.noises, self.talk = noises, talk

    def piece(self, rng: np.random.Generator, sounds: Sequence[np.ndarray], n: int) -> np.ndarray:
        sound = sounds[rng.integers(len(sounds))]
        if len(sound) < n:
            sound = np.tile(sound, n // max(len(sound), 1) + 1)
        start = rng.integers(0, len(sound) - n + 1)
        return sound[start : start + n]

    def background(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """float32[n] of unit power."""
        from sounds import by_formula, unit

        kind = rng.random()
        if kind < 0.3 and self.noises:
            return unit(equalised(self.piece(rng, self.noises, n), rng, 3))
        if kind < 0.45 and self.talk:
            babble = sum(unit(self.piece(rng, self.talk, n)) for _ in range(rng.integers(2, 7)))
            return unit(np.asarray(babble))
        return by_formula(rng, n)

    def voice(self, audio: np.ndarray, rng: np.random.Generator, gentle: bool = False) -> np.ndarray:
        """The same word by another mouth into another microphone. Gentle for real voices: their speed is natural."""
        width = 0.12 if gentle else 0.18
        if rng.random() < 0.9:
            audio = faster(audio, float(np.exp(rng.uniform(-width, width))))
        if rng.random() < 0.4:
            audio = stretched(audio, float(np.exp(rng.uniform(-0.25, 0.25))))
        if rng.random() < 0.08:
            audio = shouted(audio, rng)
        if rng.random() < 0.8:
            audio = equalised(audio, rng, rng.uniform(1, 5))
        if rng.random() < 0.2:
            audio = clipped(audio, rng.uniform(1, 8))
        return audio

    def heard(self, dry: np.ndarray, rng: np.random.Generator, quiet: bool = False, hard: bool = False) -> np.ndarray:
        """A stretch of sound as the robot's microphone has it: in a room, over a background, at some level.

        Quiet: the background is faint. Hard: the room echoes or the background is loud, mostly both.
        """
        if hard:
            if rng.random() < 0.6:
                dry = reverberated(dry, rng, rng.uniform(0.3, 0.9), rng.uniform(0.2, 0.7))
            snr_db = rng.uniform(-3, 12) if rng.random() < 0.7 else rng.uniform(12, 30)
        else:
            if rng.random() < 0.5:
                dry = reverberated(dry, rng, rng.uniform(0.1, 0.9), rng.uniform(0.25, 0.95))
            snr_db = rng.uniform(15, 40) if quiet or rng.random() < 0.35 else rng.uniform(-2, 25)
        noise = self.background(rng, len(dry)) * np.sqrt(power(dry) / 10 ** (snr_db / 10))
        mixed = dry + noise
        peak_db = rng.uniform(-34, 0) if rng.random() < 0.9 else rng.uniform(0, 8)
        mixed = mixed * 10 ** (peak_db / 20) / max(float(np.abs(mixed).max()), 1e-6)
        return np.clip(mixed, -1, 1).astype(np.float32)

    def placed(self, clip: np.ndarray, end: int, rng: np.random.Generator, context: bool = False) -> np.ndarray:
        """float32[SPAN] with the clip in it: its sample `end` up to 80 ms before the first of SHIFTS windows ends.

        Before it is silence, or other talk that breaks off.
        """
        at = SPAN - (SHIFTS - 1) * features.STEP - int(rng.integers(0, features.STEP))
        clip = clip[max(0, end - at) :]
        start = max(0, at - end)
        audio = np.zeros(SPAN, np.float32)
        clip = clip[: SPAN - start]
        audio[start : start + len(clip)] = clip
        until = start - int(rng.uniform(0.02, 0.35) * RATE)
        if context and self.talk and until > RATE // 10:
            talk = self.piece(rng, self.talk, until)
            audio[:until] += talk * np.sqrt(power(clip) / power(talk)) * rng.uniform(0.2, 1.2)
        return audio

    def mel(self, heard: np.ndarray) -> np.ndarray:
        """float32[frames, 32], exactly STEPS steps of it."""
        return features.log_mel(heard)[: features.FRAMES + (STEPS - 1) * features.STEP_FRAMES]
