"""Walks ahead until the sonars hear something near: follow_sonar.py --ip 127.0.0.1 --near 0.6"""

import argparse
import time

from naoqi import ALProxy

LEFT = "Device/SubDeviceList/US/Left/Sensor/Value"
RIGHT = "Device/SubDeviceList/US/Right/Sensor/Value"


def main(ip: str, port: int, near: float) -> None:
    memory = ALProxy("ALMemory", ip, port)
    motion = ALProxy("ALMotion", ip, port)
    sonar = ALProxy("ALSonar", ip, port)
    sonar.subscribe("follow_sonar")
    motion.wakeUp()
    motion.moveInit()
    left, right = memory.getListData([LEFT, RIGHT])
    try:
        while min(left, right) > near:
            # Towards the side with more room.
            turn = 0.2 if left > right + 0.1 else -0.2 if right > left + 0.1 else 0.0
            motion.moveToward(0.8, 0.0, turn, [["MaxStepFrequency", 0.8]])
            time.sleep(0.05)
            if not motion.moveIsActive():
                print("walked into something that the sonars do not hear")
                break
            left, right = memory.getListData([LEFT, RIGHT])
    finally:
        motion.stopMove()
        sonar.unsubscribe("follow_sonar")
    print(f"stands, {left:.2f} m free to the left and {right:.2f} m to the right")
    motion.rest()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ip", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9559)
    parser.add_argument("--near", type=float, default=0.6)
    main(**vars(parser.parse_args()))
