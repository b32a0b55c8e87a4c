"""Records what the camera sees as a film: record_video.py --ip 127.0.0.1 --out nao.avi"""

import argparse
import time

import cv2
import numpy as np
import qi

BOTTOM, QVGA, BGR, FPS = 1, 1, 13, 10


def main(ip: str, port: int, frames: int, out: str) -> None:
    session = qi.Session()
    session.connect(f"tcp://{ip}:{port}")
    video = session.service("ALVideoDevice")
    video.setActiveCamera(BOTTOM)
    client = video.subscribe("record_video", QVGA, BGR, FPS)
    video.setActiveCamera(client, 0)
    film = cv2.VideoWriter(out, cv2.VideoWriter.fourcc(*"MJPG"), FPS, (320, 240))
    written, begun = 0, time.time()
    try:
        while written < frames:
            image = video.getImageRemote(client)
            if image is None:
                continue
            film.write(np.frombuffer(image[6], np.uint8).reshape(image[1], image[0], 3))
            video.releaseImage(client)
            written += 1
            time.sleep(max(0.0, begun + written / FPS - time.time()))
    finally:
        video.unsubscribe(client)
        film.release()
        session.close()
    print(f"{written} frames in {out}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ip", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9559)
    parser.add_argument("--frames", type=int, default=50)
    parser.add_argument("--out", default="nao.avi")
    main(**vars(parser.parse_args()))
