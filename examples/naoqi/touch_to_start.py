"""Waits for a hand on its head, then stands up and greets: touch_to_start.py --ip 127.0.0.1"""

import argparse
import threading

import qi


def main(ip: str, port: int, wait_s: float) -> None:
    session = qi.Session()
    session.connect(f"tcp://{ip}:{port}")
    memory = session.service("ALMemory")
    touched = threading.Event()

    def on_touch(value: float) -> None:
        if value == 1.0:
            touched.set()

    subscriber = memory.subscriber("FrontTactilTouched")
    link = subscriber.signal.connect(on_touch)
    print("touch my head to begin", flush=True)
    if touched.wait(wait_s):
        subscriber.signal.disconnect(link)
        session.service("ALMotion").wakeUp()
        session.service("ALAnimatedSpeech").say(
            "^start(animations/Stand/Gestures/Hey_1) Hello! ^wait(animations/Stand/Gestures/Hey_1)"
        )
        session.service("ALBehaviorManager").runBehavior("animations/Stand/Gestures/Hey_1")
        session.service("ALMotion").rest()
    else:
        print("nobody came")
    session.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ip", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9559)
    parser.add_argument("--wait-s", type=float, default=60.0)
    main(**vars(parser.parse_args()))
