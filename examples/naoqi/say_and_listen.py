"""Says something and hears, by events, when each sentence is over: say_and_listen.py --ip ..."""

import argparse
import time

from naoqi import ALBroker, ALModule, ALProxy


class Listener(ALModule):
    """Is called back by ALMemory."""

    def __init__(self, name: str) -> None:
        ALModule.__init__(self, name)
        self.sentences: list[str] = []
        self.done = 0

    def onSentence(self, key: str, value: str, message: str) -> None:
        self.sentences.append(value)

    def onDone(self, *event: object) -> None:
        self.done += event[1] == 1


def main(ip: str, port: int) -> None:
    broker = ALBroker("listening", "0.0.0.0", 0, ip, port)
    listener = Listener("Listener")
    memory = ALProxy("ALMemory")
    speech = ALProxy("ALTextToSpeech")
    memory.subscribeToEvent("ALTextToSpeech/CurrentSentence", "Listener", "onSentence")
    memory.subscribeToEvent("ALTextToSpeech/TextDone", "Listener", "onDone")
    speech.setLanguage("English")
    speech.setVolume(0.7)
    speech.setParameter("pitchShift", 1.1)
    speech.say("\\rspd=120\\Hello, \\pau=100\\I am a robot.")
    number = speech.post.say("And I can listen.")
    speech.wait(number, 0)
    deadline = time.time() + 5
    while listener.done < 2 and time.time() < deadline:
        time.sleep(0.02)
    memory.unsubscribeToEvent("ALTextToSpeech/TextDone", "Listener")
    print(f"heard {listener.done} ends: {listener.sentences}")
    broker.shutdown()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ip", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9559)
    main(**vars(parser.parse_args()))
