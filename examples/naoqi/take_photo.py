"""Takes a photo with NAO's top camera: take_photo.py --ip 127.0.0.1 --port 9559 --out photo.png"""

import argparse

import cv2
import numpy as np

from naoqi import ALProxy

TOP, VGA, BGR = 0, 2, 13


def main(ip: str, port: int, out: str) -> None:
    video = ALProxy("ALVideoDevice", ip, port)
    client = video.subscribeCamera("take_photo", TOP, VGA, BGR, 5)
    try:
        image = video.getImageRemote(client)
        video.releaseImage(client)
    finally:
        video.unsubscribe(client)
    width, height, pixels = image[0], image[1], image[6]
    cv2.imwrite(out, np.frombuffer(pixels, np.uint8).reshape(height, width, 3))
    print(f"{width}x{height} written to {out}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ip", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9559)
    parser.add_argument("--out", default="photo.png")
    main(**vars(parser.parse_args()))
