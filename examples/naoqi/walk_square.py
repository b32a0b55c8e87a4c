"""Walks a square and comes back to where it began: walk_square.py --ip 127.0.0.1 --side 0.3"""

import argparse
import math

from naoqi import ALProxy


def main(ip: str, port: int, side: float) -> None:
    motion = ALProxy("ALMotion", ip, port)
    posture = ALProxy("ALRobotPosture", ip, port)
    motion.wakeUp()
    posture.goToPosture("StandInit", 0.5)
    motion.setMoveArmsEnabled(True, True)
    motion.setMotionConfig([["ENABLE_FOOT_CONTACT_PROTECTION", True]])
    for corner in range(4):
        there = motion.moveTo(side, 0.0, 0.0, [["MaxStepX", 0.06], ["MaxStepFrequency", 1.0]])
        if not there:
            print(f"something is in the way on side {corner + 1}")
            break
        motion.moveTo(0.0, 0.0, math.pi / 2)
    x, y, theta = motion.getRobotPosition(True)
    print(f"at {x:.2f} m, {y:.2f} m, {math.degrees(theta):.0f} deg")
    motion.rest()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ip", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9559)
    parser.add_argument("--side", type=float, default=0.3)
    main(**vars(parser.parse_args()))
