"""What a virtual robot's services keep, answer and raise."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from doorway3ds.images.codec import read_image
from doorway3ds.lab.sim.robot.body import Body, FastClock
from doorway3ds.lab.sim.robot.model import MODELS
from doorway3ds.lab.sim.robot.nao import VirtualNao, colours
from doorway3ds.lab.sim.robot.nao.video import SIZES
from doorway3ds.robots.nao.format import COLOURS, to_rgb
from tests.lab.sim.robot.test_ground import body as walled
from tests.robots.conftest import picture

DEVICE = "Device/SubDeviceList/"


def depth(part: str, width: int, height: int) -> np.ndarray:
    return np.full((height, width), 1.5, np.float32)


def robot(model: str = "nao", body: Body | None = None) -> VirtualNao:
    made = body or Body(clock=FastClock(), model=MODELS[model])
    return VirtualNao(made, picture, depth=depth if model == "pepper" else None)


def test_memory_keeps_lists_and_forgets() -> None:
    memory = robot().memory
    memory.insertData("mine/a", 1)
    memory.insertListData([["mine/b", [1, 2]], ["mine/c", "x"]])
    assert memory.getDataList("mine/") == ["mine/a", "mine/b", "mine/c"]
    assert memory.getListData(["mine/b", "never", "mine/c"]) == [[1, 2], None, "x"]
    assert memory.getTimestamp("mine/a")[0] == 1
    memory.removeData("mine/a")
    with pytest.raises(RuntimeError, match="mine/a was never set"):
        memory.getData("mine/a")
    memory.declareEvent("MyEvent")
    memory.raiseMicroEvent("MyMicroEvent", 3)
    assert "MyEvent" in memory.getEventList()
    assert memory.getMicroEventList() == ["MyMicroEvent"]
    assert memory.getData("MyMicroEvent") == 3


def test_memory_knows_joints_sonars_touch_battery_and_inertial_unit() -> None:
    nao = robot(body=walled(3.0, 1.0))
    memory = nao.memory
    nao.body.aim("HeadYaw", 0.3, math.inf)
    assert memory.getData(f"{DEVICE}HeadYaw/Position/Sensor/Value") == pytest.approx(0.3)
    assert memory.getData(f"{DEVICE}US/Left/Sensor/Value") == pytest.approx(0.93, abs=0.05)
    assert memory.getData(f"{DEVICE}Battery/Charge/Sensor/Value") == 1.0
    assert memory.getData(f"{DEVICE}InertialSensor/AccZ/Sensor/Value") == pytest.approx(-9.81)
    assert memory.getData(f"{DEVICE}LFoot/FSR/TotalWeight/Sensor/Value") == pytest.approx(2.65)
    nao.services["ALRobotPosture"].goToPosture("LyingBack", 1.0)
    assert memory.getData(f"{DEVICE}InertialSensor/AngleY/Sensor/Value") == pytest.approx(
        -math.pi / 2
    )
    pepper = robot("pepper").memory
    assert pepper.getDataList("Sonar") == [
        f"{DEVICE}Platform/Back/Sonar/Sensor/Value", f"{DEVICE}Platform/Front/Sonar/Sensor/Value",
    ]  # fmt: skip
    assert pepper.getDataList("US/") == []


def test_a_touch_is_in_the_event_the_device_and_altouch() -> None:
    nao = robot()
    nao.memory.raiseEvent("MiddleTactilTouched", 1.0)
    assert nao.memory.getData(f"{DEVICE}Head/Touch/Middle/Sensor/Value") == 1.0
    assert nao.memory.getData("TouchChanged") == [["Head/Touch/Middle", True]]
    assert ["Head/Touch/Middle", True] in nao.services["ALTouch"].getStatus()
    nao.memory.raiseEvent("MiddleTactilTouched", 0.0)
    assert not any(touched for _, touched in nao.services["ALTouch"].getStatus())


def test_sonar_events_are_raised_while_somebody_subscribes() -> None:
    nao = robot(body=walled(3.6, 1.0))
    sonar = nao.services["ALSonar"]
    sonar._listen()
    assert nao.memory.getDataList("SonarLeft") == []
    sonar.subscribe("me", 500, 0.0)
    sonar._listen()
    assert nao.memory.getData("SonarLeftDetected") == pytest.approx(0.33, abs=0.05)
    assert (sonar.getCurrentPeriod(), sonar.getMyPeriod("me")) == (500, 500)
    sonar.unsubscribe("me")
    assert sonar.getSubscribersInfo() == []


def test_speech_hears_tags_and_does_not_speak_them() -> None:
    nao = robot()
    speech = nao.services["ALTextToSpeech"]
    began = nao.body.clock.now()
    speech.say("\\vct=130\\Hello\\pau=2000\\ there")
    assert nao.said == ["Hello there"]
    assert nao.body.clock.now() - began > 2.0
    assert nao.memory.getData("ALTextToSpeech/CurrentSentence") == "Hello there"
    speech.setLanguage("French")
    speech.setParameter("speed", 120)
    assert (speech.getLanguage(), speech.getVoice(), speech.getParameter("speed")) == (
        "French", "naofrf", 120.0,
    )  # fmt: skip
    for wrong in (lambda: speech.setLanguage("Klingon"), lambda: speech.setVolume(3)):
        with pytest.raises(RuntimeError, match="expected"):
            wrong()
    nao.services["ALAnimatedSpeech"].say(
        "^start(a/b) Well ^wait(a/b)", {"bodyLanguageMode": "random"}
    )
    assert nao.said[-1] == "Well"


def test_leds_keep_their_colours() -> None:
    leds = robot().services["ALLeds"]
    leds.fadeRGB("FaceLeds", 0xFF8000, 0.1)
    assert leds.getIntensity("RightFaceLed1")[0][1] == pytest.approx([1.0, 0.502, 0.0], abs=1e-3)
    leds.fadeRGB("ChestLeds", 0.0, 1.0, 0.0, 0.1)
    leds.off("LeftEarLeds")
    assert leds.getIntensity("ChestLeds") == [["ChestLed", [0.0, 1.0, 0.0]]]
    assert leds.getIntensity("LeftEarLed3")[0][1] == [0.0, 0.0, 0.0]
    assert len(leds.listGroup("AllLeds")) == 16 + 20 + 12 + 1 + 2
    with pytest.raises(RuntimeError, match="no LED or group Nose"):
        leds.on("Nose")


def test_life_awareness_behaviours_and_faces_keep_their_state() -> None:
    nao = robot()
    life, awareness, behaviours, faces = (
        nao.services[name]
        for name in ("ALAutonomousLife", "ALBasicAwareness", "ALBehaviorManager", "ALFaceDetection")
    )
    life.setState("solitary")
    life.setAutonomousAbilityEnabled("BasicAwareness", False)
    assert (life.getState(), life.getAutonomousAbilityEnabled("BasicAwareness")) == (
        "solitary", False,
    )  # fmt: skip
    assert nao.memory.getData("AutonomousLife/State") == "solitary"
    with pytest.raises(RuntimeError, match="dreaming"):
        life.setState("dreaming")
    awareness.setEngagementMode("FullyEngaged")
    awareness.setEnabled(True)
    assert (awareness.getEngagementMode(), awareness.isRunning()) == ("FullyEngaged", True)
    name = behaviours.getInstalledBehaviors()[0]
    behaviours.startBehavior(name)
    assert behaviours.getRunningBehaviors() == [name]
    nao.body.clock.sleep(2.0)
    assert not behaviours.isBehaviorRunning(name)
    assert not faces.learnFace("Ada")
    nao.memory.raiseEvent("FaceDetected", [[0, 0], [[]]])
    assert faces.learnFace("Ada")
    assert faces.getLearnedFacesList() == ["Ada"]


def test_the_tracker_looks_at_points_and_knows_its_targets() -> None:
    nao = robot()
    tracker, motion = nao.services["ALTracker"], nao.services["ALMotion"]
    motion.wakeUp()
    neck = motion.getPosition("HeadYaw", 2, True)
    tracker.lookAt([neck[0] + 1.0, 1.0, neck[2]], 2, 0.5, False)
    assert motion.getAngles(["HeadYaw", "HeadPitch"], True) == pytest.approx(
        [np.pi / 4, 0.0], abs=1e-3
    )
    with pytest.raises(RuntimeError, match="register Face"):
        tracker.track("Face")
    tracker.registerTarget("Face", 0.1)
    tracker.track("Face")
    assert (tracker.getActiveTarget(), tracker.isTargetLost()) == ("Face", True)
    tracker.stopTracker()
    assert not tracker.isActive()


def test_battery_and_system_answer() -> None:
    nao = robot()
    assert nao.services["ALBattery"].getBatteryCharge() == 100
    nao.body.clock.sleep(2700)
    assert nao.services["ALBattery"].getBatteryCharge() == 50
    assert nao.services["ALSystem"].robotName() == "nao"
    assert nao.services["ALSystem"].systemVersion().startswith("2.8")


@pytest.mark.parametrize("resolution", sorted(SIZES))
def test_images_have_the_size_that_was_asked_for(resolution: int) -> None:
    video = robot().video
    image = video.getImageRemote(video.subscribeCamera("me", 1, resolution, 11, 10))
    assert tuple(image[:2]) == SIZES[resolution]
    assert len(image[6]) == image[0] * image[1] * 3
    assert image[7] == 1


@pytest.mark.parametrize("colour", sorted(colours.LAYERS))
def test_every_colour_space_has_as_many_bytes_as_it_says(colour: int) -> None:
    pepper = robot("pepper").video
    camera = 2 if colour in (17, 19, 20, 21, 23) else 0
    image = pepper.getImageRemote(pepper.subscribeCamera("me", camera, 1, colour, 10))
    assert len(image[6]) == 320 * 240 * image[2]
    if colour in COLOURS.values():
        grey = cv2.cvtColor(to_rgb(image), cv2.COLOR_RGB2GRAY).astype(float)
        wanted = cv2.cvtColor(picture("CameraTop", 320, 240), cv2.COLOR_RGB2GRAY)
        assert np.abs(grey - wanted).mean() < 3


def test_peppers_depth_is_in_millimetres_and_nao_has_none() -> None:
    pepper = robot("pepper").video
    handle = pepper.subscribeCamera("me", 2, 1, 17, 10)
    image = pepper.getImageRemote(handle)
    assert np.frombuffer(image[6], np.uint16).reshape(240, 320)[120, 160] == 1500
    assert np.degrees(image[8] - image[10]) == pytest.approx(58.0)
    pepper.setColorSpace(handle, 19)
    points = np.frombuffer(pepper.getImageRemote(handle)[6], np.float32).reshape(240, 320, 3)
    assert points[120, 160] == pytest.approx([1.5, 0.0, 0.0], abs=0.01)
    assert points[120, 0, 1] == pytest.approx(1.5 * np.tan(np.radians(29.0)), abs=0.01)  # left
    assert robot().video.subscribeCamera("me", 2, 1, 17, 10) == ""
    assert robot().video.hasDepthCamera() is False


def test_subscriptions_are_changed_and_many_cameras_answer_at_once() -> None:
    video = robot().video
    handle = video.subscribe("old", 1, 13, 10)
    assert video.getActiveCamera(handle) == 0
    assert video.setActiveCamera(handle, 1)
    assert video.setResolution(handle, 2)
    assert video.setColorSpace(handle, 0)
    assert video.setFrameRate(handle, 30)
    image = video.getImageLocal(handle)
    assert [*image[:4], image[7]] == [640, 480, 1, 0, 1]
    assert not video.setResolution(handle, 99)
    assert not video.setFrameRate("nobody", 10)
    both = video.subscribeCameras("both", [0, 1], [1, 0], [11, 13], 10)
    assert [i[:4] for i in video.getImagesRemote(both)] == [(320, 240, 3, 11), (160, 120, 3, 13)]
    assert video.subscribeCameras("both", [0, 9], [1, 0], [11, 13], 10) == ""
    assert video.unsubscribe(both)


def test_camera_parameters_are_kept_and_flips_are_seen() -> None:
    video = robot().video
    assert video.getParameter(0, 0) == 55
    assert video.setParameter(0, 0, 100)
    assert not video.setParameter(0, 0, 999)
    assert (video.getParameter(0, 0), video.getParameter(1, 0)) == (100, 55)
    video.setParam(0, 120)
    assert video.getParam(0) == 120
    handle = video.subscribeCamera("me", 0, 1, 11, 30)
    upright = to_rgb(video.getImageRemote(handle))
    video.setParameter(0, 7, 1)
    assert np.array_equal(to_rgb(video.getImageRemote(handle)), upright[:, ::-1])
    assert video.setAllParametersToDefault(0)
    assert video.getParameter(0, 0) == 55


def test_optional_arguments_may_be_left_out_and_wrong_ones_are_said() -> None:
    services: Any = robot().services
    assert services["ALMotion"].getAngles("HeadYaw") == [0.0]
    assert services["ALMemory"].getData("footContact", 0) == 1.0
    with pytest.raises(RuntimeError, match=r"Motion::getAngles .*argument"):
        services["ALMotion"].getAngles()
    assert services["ALMotion"].ping() is True
    assert "moveTo" in services["ALMotion"].getMethodList()


def test_services_without_effect_keep_what_is_set() -> None:
    nao = robot()
    audio, hearing = nao.services["ALAudioDevice"], nao.services["ALSpeechRecognition"]
    assert audio.getOutputVolume() == 50
    audio.setOutputVolume(70)
    audio.muteAudioOut(True)
    assert (audio.getOutputVolume(), audio.isAudioOutMuted()) == (70, True)
    hearing.setParameter("Sensitivity", 0.4)
    hearing.setParameter("NbHypotheses", 2)
    assert [hearing.getParameter(n) for n in ("Sensitivity", "NbHypotheses")] == [0.4, 2]
    hearing.subscribe("me")
    assert hearing.getSubscribersInfo()[0][0] == "me"
    assert nao.services["ALMemory"].getData("WordRecognized") == ["", -3.0]
    with pytest.raises(RuntimeError, match="ALAudioDevice::setOutputVolume expected a value"):
        audio.setOutputVolume()


def test_photographs_go_into_a_folder_of_the_robots_own() -> None:
    nao = robot()
    capture = nao.services["ALPhotoCapture"]
    capture.setResolution(1)
    (path,) = capture.takePicture("../../etc", "hall")
    assert read_image(path).image.shape == (240, 320, 3)
    assert ".." not in Path(path).parts and Path(path).name == "etc_hall.jpg"
    assert len({*capture.takePictures(3, "/home/nao", "room.png")}) == 3
    with pytest.raises(RuntimeError, match="expected jpg or png, got raw"):
        capture.takePicture("/home/nao", "room.raw")


def test_navigation_goes_straight_and_stops_where_walking_does() -> None:
    nao = robot()
    nao.services["ALMotion"].wakeUp()
    navigation = nao.services["ALNavigation"]
    assert navigation.navigateTo(0.3, 0.0) is True
    line = ["Composed", ["Holonomic", ["Line", [0.2, 0.0]], 0.0, 2.0]]
    assert navigation.moveAlong(line) is True
    assert nao.body.odometry()[0] == pytest.approx(0.5, abs=0.1)


def test_topics_of_a_dialog_are_listed() -> None:
    nao = robot()
    dialog = nao.services["ALDialog"]
    topic = dialog.loadTopicContent("topic: ~hello()\nlanguage: enu\nu:(hi) hello\n")
    dialog.activateTopic(topic)
    assert dialog.getActivatedTopics() == dialog.getLoadedTopics("English") == ["hello"]
    dialog.unloadTopic(topic)
    assert dialog.getLoadedTopics() == []
    with pytest.raises(RuntimeError, match="no topic hello is loaded"):
        dialog.activateTopic(topic)


def test_a_tablet_is_peppers_alone() -> None:
    for model, has in (("nao", False), ("pepper", True)):
        services = robot(model).services
        assert ("ALTabletService" in services) is has
    assert services["ALTabletService"].showImage("http://198.18.0.1/a.png") is True
