"""Keeps its eyes on a red ball: track_ball.py --ip 127.0.0.1 --looks 20"""

import argparse

import cv2
import numpy as np

from naoqi import ALProxy

TOP, QVGA, RGB = 0, 1, 11


def main(ip: str, port: int, looks: int) -> None:
    motion = ALProxy("ALMotion", ip, port)
    video = ALProxy("ALVideoDevice", ip, port)
    motion.setStiffnesses("Head", 1.0)
    client = video.subscribeCamera("track_ball", TOP, QVGA, RGB, 30)
    video.setParameter(TOP, 11, 1)  # automatic exposure
    try:
        for _ in range(looks):
            image = video.getImageRemote(client)
            width, height = image[0], image[1]
            pixels = np.frombuffer(image[6], np.uint8).reshape(height, width, 3).astype(int)
            red = (pixels[..., 0] > pixels[..., 1:].max(-1) + 60).astype(np.uint8)
            size = cv2.moments(red, binaryImage=True)
            if size["m00"] == 0:
                continue
            at = [size["m10"] / size["m00"] / width, size["m01"] / size["m00"] / height]
            yaw, pitch = video.getAngularPositionFromImagePosition(TOP, at)
            motion.angleInterpolation(
                ["HeadYaw", "HeadPitch"], [yaw * 0.8, pitch * 0.8], [0.2, 0.2], False
            )
    finally:
        video.unsubscribe(client)
    print("looks at", motion.getAngles(["HeadYaw", "HeadPitch"], True))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ip", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9559)
    parser.add_argument("--looks", type=int, default=20)
    main(**vars(parser.parse_args()))
