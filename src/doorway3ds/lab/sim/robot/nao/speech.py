"""ALTextToSpeech and ALAnimatedSpeech of a virtual NAO: what was said is kept."""

from __future__ import annotations

import re
import threading
from typing import TYPE_CHECKING, Any

from doorway3ds.lab.sim.robot.nao.service import Extractor, Service, asked

if TYPE_CHECKING:
    from doorway3ds.lab.sim.robot.nao.robot import VirtualNao

_VOICES = {
    "English": ("naoenu", "en_US"), "French": ("naofrf", "fr_FR"), "German": ("naoged", "de_DE"),
    "Japanese": ("naojpj", "ja_JP"), "Chinese": ("naomnc", "zh_CN"), "Spanish": ("naospe", "es_ES"),
    "Italian": ("naoiti", "it_IT"),
}  # fmt: skip
_TAG = re.compile(r"\\+(\w+)(?:=([^\\]*))?\\+")
_GESTURE = re.compile(r"\^\w+(?:\([^)]*\))?")
_SLICE_S = 0.05


class Speech(Service, name="ALTextToSpeech"):
    """ALTextToSpeech: what was said is kept and handed to `VirtualNao.on_speech`."""

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._language, self._voice, self._volume = "English", "naoenu", 0.5
        self._dictionary: dict[str, str] = {}
        self._speaking = threading.Lock()
        self._stops = 0
        self._count = 0

    def say(self, text: str, language: str = "") -> None:
        """Says it and waits until it is said. Tags as \\rspd=80\\ are heard, not spoken."""
        if language:
            self._one("say", language, _VOICES)
        stops = self._stops
        with self._speaking:
            self._say(text, stops)

    def _say(self, text: str, stops: int) -> None:
        nao, memory = self._nao, self._nao.memory
        self._count += 1
        speed, pause = asked(self, "getParameter", "speed"), 0.0
        for name, value in _TAG.findall(text):
            if name == "rspd" and value:
                speed = float(value)
            elif name == "pau" and value:
                pause += float(value) / 1000
            elif name == "mrk" and value:
                memory.raiseEvent("ALTextToSpeech/CurrentBookMark", int(value))
        words = " ".join(_GESTURE.sub(" ", _TAG.sub(" ", text)).split())
        nao.said.append(words)
        nao.on_speech(words)
        memory.raiseEvent("ALTextToSpeech/CurrentSentence", words)
        memory.raiseEvent("ALTextToSpeech/TextStarted", 1)
        memory.raiseEvent("ALTextToSpeech/Status", [self._count, "started"])
        left = pause + min(0.05 * len(words), 3.0) * 100 / max(speed, 50.0)
        while left > 0 and self._stops == stops:
            nao.body.clock.sleep(min(_SLICE_S, left))
            left -= _SLICE_S
        stopped = self._stops != stops
        memory.raiseEvent("ALTextToSpeech/TextStarted", 0)
        if stopped:
            memory.raiseEvent("ALTextToSpeech/TextInterrupted", 1)
        memory.raiseEvent("ALTextToSpeech/TextDone", 0 if stopped else 1)
        memory.raiseEvent("ALTextToSpeech/Status", [self._count, "stopped" if stopped else "done"])

    def stopAll(self) -> None:
        self._stops += 1

    def setLanguage(self, language: str) -> None:
        self._language = self._one("setLanguage", language, _VOICES)
        self._voice = _VOICES[language][0]

    def getLanguage(self) -> str:
        return self._language

    def locale(self) -> str:
        return _VOICES[self._language][1]

    def getAvailableLanguages(self) -> list[str]:
        return list(_VOICES)

    getSupportedLanguages = getAvailableLanguages

    def getAvailableVoices(self) -> list[str]:
        return [voice for voice, _ in _VOICES.values()]

    def setVoice(self, voice: str) -> None:
        self._voice = self._one("setVoice", voice, self.getAvailableVoices())

    def getVoice(self) -> str:
        return self._voice

    def setVolume(self, volume: float) -> None:
        if not 0 <= volume <= 1:
            raise RuntimeError(f"ALTextToSpeech::setVolume expected 0 to 1, got {volume}")
        self._volume = float(volume)

    def getVolume(self) -> float:
        return self._volume

    def resetSpeed(self) -> None:
        usual = asked(self, "getParameter", "defaultVoiceSpeed")
        asked(self, "setParameter", "speed", usual)

    def reset(self) -> None:
        self._unset("getParameter")

    def addToDictionary(self, word: str, spoken: str) -> bool:
        self._dictionary[word] = spoken
        return True

    def deleteFromDictionary(self, word: str) -> bool:
        return self._dictionary.pop(word, None) is not None


class AnimatedSpeech(Service, name="ALAnimatedSpeech"):
    """ALAnimatedSpeech: speaks as ALTextToSpeech does; gestures are left out."""

    _MODES = ("disabled", "random", "contextual")
    _mode = 2

    def say(self, text: str, configuration: Any = None) -> None:
        self._nao.services["ALTextToSpeech"].say(text)

    def setBodyLanguageMode(self, mode: int) -> None:
        self._mode = self._one("setBodyLanguageMode", int(mode), range(3))

    def getBodyLanguageMode(self) -> int:
        return self._mode

    def setBodyLanguageModeFromStr(self, mode: str) -> None:
        self._one("setBodyLanguageModeFromStr", mode, self._MODES)
        self._mode = self._MODES.index(mode)

    def getBodyLanguageModeToStr(self) -> str:
        return self._MODES[self._mode]

    def setBodyLanguageEnabled(self, enabled: bool) -> None:
        self._mode = 2 if enabled else 0

    def isBodyLanguageEnabled(self) -> bool:
        return self._mode > 0

    setBodyTalkEnabled, isBodyTalkEnabled = setBodyLanguageEnabled, isBodyLanguageEnabled


class Dialog(Extractor, name="ALDialog"):
    """ALDialog: topics are loaded, activated and listed; nobody talks to the robot."""

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._topics: dict[str, bool] = {}

    def loadTopic(self, path: str) -> str:
        """Takes the file's name for the topic's."""
        return self._load(path.rpartition("/")[2].partition("_")[0].partition(".")[0])

    def loadTopicContent(self, content: str) -> str:
        found = re.search(r"topic:\s*~(\w+)", content)
        if found is None:
            raise RuntimeError("ALDialog::loadTopicContent expected a line topic: ~name()")
        return self._load(found[1])

    def unloadTopic(self, topic: str) -> None:
        self._known(topic)
        del self._topics[topic]

    def activateTopic(self, topic: str) -> None:
        self._topics[self._known(topic)] = True

    def deactivateTopic(self, topic: str) -> None:
        self._topics[self._known(topic)] = False

    def getLoadedTopics(self, language: str = "") -> list[str]:
        return list(self._topics)

    getAllLoadedTopics = getLoadedTopics

    def getActivatedTopics(self) -> list[str]:
        return [topic for topic, active in self._topics.items() if active]

    def _load(self, topic: str) -> str:
        self._topics[topic] = False
        return topic

    def _known(self, topic: str) -> str:
        if topic not in self._topics:
            raise RuntimeError(f"ALDialog: no topic {topic} is loaded")
        return topic
