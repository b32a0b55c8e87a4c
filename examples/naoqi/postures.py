"""Goes through all postures that the robot knows and rests: postures.py --ip 127.0.0.1"""

import argparse

from naoqi import ALProxy


def main(ip: str, port: int) -> None:
    life = ALProxy("ALAutonomousLife", ip, port)
    motion = ALProxy("ALMotion", ip, port)
    posture = ALProxy("ALRobotPosture", ip, port)
    if life.getState() != "disabled":
        life.setState("disabled")
    motion.wakeUp()
    posture.setMaxTryNumber(3)
    for name in posture.getPostureList():
        reached = posture.goToPosture(name, 0.8)
        print(f"{name}: {'reached' if reached else 'failed'}, {posture.getPostureFamily()}")
    motion.rest()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ip", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9559)
    main(**vars(parser.parse_args()))
