"""Plays with the LEDs of eyes, ears and chest: led_show.py --ip 127.0.0.1"""

import argparse

import qi


def main(ip: str, port: int) -> None:
    session = qi.Session()
    session.connect(f"tcp://{ip}:{port}")
    leds = session.service("ALLeds")
    leds.off("AllLeds")
    leds.rotateEyes(0x0000FF, 0.5, 1.0)
    leds.rasta(0.6)
    leds.randomEyes(0.6)
    leds.createGroup("Show", ["FaceLeds", "ChestLeds"])
    leds.fadeListRGB("Show", [0xFF0000, 0x00FF00], [0.2, 0.4])
    for name in ("yellow", "cyan", "magenta"):
        leds.fadeRGB("Show", name, 0.2)
    leds.fade("EarLeds", 0.5, 0.2)
    leds.on("BrainLeds")
    print("chest:", leds.getIntensity("ChestLeds"))
    session.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ip", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9559)
    main(**vars(parser.parse_args()))
