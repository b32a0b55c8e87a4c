"""Looks left, right, up and down with the head alone: look_around.py --ip 127.0.0.1"""

import argparse

import qi


def main(ip: str, port: int) -> None:
    session = qi.Session()
    session.connect(f"tcp://{ip}:{port}")
    motion = session.service("ALMotion")
    motion.stiffnessInterpolation("Head", 1.0, 0.5)
    low, high = motion.getLimits("HeadYaw")[0][:2]
    yaw = [high / 2, low / 2, 0.0]
    pitch = [-0.3, 0.2, 0.0]
    motion.angleInterpolation(["HeadYaw", "HeadPitch"], [yaw, pitch], [[1, 2, 3], [1, 2, 3]], True)
    motion.setAngles("HeadYaw", 0.4, 0.2)
    motion.changeAngles("HeadPitch", 0.1, 0.2)
    motion.angleInterpolationWithSpeed(["HeadYaw", "HeadPitch"], [0.3, 0.1], 0.2)
    print("head at", motion.getAngles("Head", True))
    motion.setStiffnesses("Head", 0.0)
    session.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ip", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9559)
    main(**vars(parser.parse_args()))
