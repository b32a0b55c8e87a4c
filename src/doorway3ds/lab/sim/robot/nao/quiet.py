"""NAOqi's services that a virtual NAO answers for and that do nothing: as tables, not as code.

What is set is kept and answered for; nobody is heard, seen or met, nothing is played or recorded.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from doorway3ds.lab.sim.robot.nao.service import Quiet

_CAMERA = {"ActiveCamera": 0, "Resolution": 1, "FrameRate": 10, "pause/isPaused": False}
_EXTRACTOR = {"isProcessing": False, "getEventList": [], "getOutputNames": []}


def _sees(does: str = "", answers: Mapping[str, Any] | None = None, **keeps: Any) -> Quiet:
    """An extractor of images."""
    return Quiet({**_CAMERA, **keeps}, {**_EXTRACTOR, **(answers or {})}, does, extractor=True)


def _hears(does: str = "", answers: Mapping[str, Any] | None = None, **keeps: Any) -> Quiet:
    """An extractor of sound."""
    return Quiet(keeps, {**_EXTRACTOR, **(answers or {})}, does, extractor=True)


_RECORDS = "startMicrophonesRecording stopMicrophonesRecording"

QUIET: dict[str, Quiet] = {
    # Sound.
    "ALAudioDevice": Quiet(
        {"OutputVolume": 50, "Parameter": 0, "muteAudioOut/isAudioOutMuted": False},
        {
            **dict.fromkeys(
                ("getFrontMicEnergy", "getRearMicEnergy", "getLeftMicEnergy", "getRightMicEnergy"),
                0.0,
            ),
            "isInputClosed": False,
            "isOutputClosed": False,
        },
        f"{_RECORDS} enableEnergyComputation disableEnergyComputation setClientPreferences "
        "subscribe unsubscribe playSine flushAudioOutputs openAudioInputs closeAudioInputs "
        "openAudioOutputs closeAudioOutputs",
    ),
    "ALAudioPlayer": Quiet(
        {"Volume": 1.0, "MasterVolume": 0.5, "Panorama": 0.0},
        {
            "loadFile": 1,
            "getCurrentPosition": 0.0,
            "getFileLength": 0.0,
            "getLoadedFilesIds": [],
            "getLoadedFilesNames": [],
            "getInstalledSoundSetsList": ["Aldebaran"],
            "getLoadedSoundSetsList": ["Aldebaran"],
            "getSoundSetFileNames": [],
        },
        "playFile playFileInLoop playFileFromPosition playFileInLoopFromPosition unloadFile "
        "unloadAllFiles play playInLoop pause stop stopAll goTo playSoundSetFile playWebStream "
        "loadSoundSet unloadSoundSet",
    ),
    "ALAudioRecorder": Quiet(does=f"{_RECORDS} recordingPause"),
    "ALSpeechRecognition": _hears(
        "setVocabulary setWordListAsVocabulary addContext removeContext removeAllContext "
        "saveContextSet loadContextSet eraseContextSet activateRule deactivateRule "
        "activateAllRules deactivateAllRules compile",
        {"getAvailableLanguages": ["English"], "getRules": []},
        Language="English",
        Parameter=0.0,
        AudioExpression=True,
        VisualExpression=True,
        **{"setVisualExpressionMode/getVisualExpressionMode": 2, "pause/isPaused": False},
    ),
    "ALSoundDetection": _hears(Parameter=0.4),
    "ALSoundLocalization": _hears(Parameter=0.5),
    "ALVoiceEmotionAnalysis": _hears(),
    # Sight.
    "ALBacklightingDetection": _sees(),
    "ALBarcodeReader": _sees(),
    "ALCloseObjectDetection": _sees(),
    "ALColorBlobDetection": _sees(
        "setColor setObjectProperties", {"getColor": [0, 0, 0, 0], "getCircle": []}
    ),
    "ALDarknessDetection": _sees(DarknessThreshold=40),
    "ALEngagementZones": _sees(
        FirstLimitDistance=1.5, SecondLimitDistance=2.5, LimitAngle=90.0
    ),
    "ALFaceCharacteristics": _sees(
        answers={"analyzeFaceCharacteristics": False}, SmilingThreshold=0.7
    ),
    "ALGazeAnalysis": _sees(
        FaceAnalysisEnabled=False, Tolerance=0.5,
    ),
    "ALLandMarkDetection": _sees(),
    "ALMovementDetection": _sees(
        "resetDetection", DepthSensitivity=0.1, ColorSensitivity=0.5
    ),
    "ALPeoplePerception": _sees(
        "resetPopulation",
        FastModeEnabled=False,
        GraphicalDisplayEnabled=False,
        MovementDetectionEnabled=True,
        FaceDetectionEnabled=True,
        MaximumDetectionRange=3.5,
        MinimumBodyHeight=0.3,
        MaximumBodyHeight=2.1,
        TimeBeforePersonDisappears=3.0,
        TimeBeforeVisiblePersonDisappears=3.0,
    ),
    "ALRedBallDetection": _sees(),
    "ALSegmentation3D": _sees(
        answers={"getNumberOfBlobs": 0, "getTopOfBlob": []},
        BlobTrackingEnabled=False,
        DeltaDepthThreshold=0.1,
        VerticalOffset=0.0,
    ),
    "ALSittingPeopleDetection": _sees(SittingThreshold=1.35),
    "ALVideoRecorder": Quiet(
        {
            "CameraID": 0,
            "ColorSpace": 11,
            "FrameRate": 10.0,
            "Resolution": 1,
            "VideoFormat": "MJPG",
        },
        {"isRecording": False, "stopRecording": [0, ""]},
        "startRecording",
    ),
    "ALVisionRecognition": _sees(
        "clearCurrentDatabase",
        {"load": True, "changeDatabase": True, "getSize": 0, "learnFromFile": False},
        Param=0,
        MaxOutObjs=1,
    ),
    "ALVisualCompass": _sees(
        "setCurrentImageAsReference", {"moveTo": True, "moveStraightTo": True},
        ReferenceImage=[],
    ),
    "ALWavingDetection": _sees(MaxDistance=2.5, MinSize=0.1),
    # Body and life.
    "ALAutonomousBlinking": Quiet({"Enabled": False}),
    "ALAutonomousMoves": Quiet({"BackgroundStrategy": "none", "ExpressiveListeningEnabled": True}),
    "ALBackgroundMovement": Quiet({"Enabled": False}),
    "ALBodyTemperature": Quiet(
        {"setEnableNotifications/areNotificationsEnabled": False},
        {"getTemperatureDiagnosis": []},
    ),
    "ALListeningMovement": Quiet({"Enabled": False}),
    "ALSpeakingMovement": Quiet({"Enabled": False, "Mode": "contextual"}, does="addTagsToWords"),
    "ALSensors": Quiet(extractor=True),
    "ALLaser": Quiet(does="laserON laserOFF setOpeningAngle setDetectingLength"),
    "ALLocalization": Quiet(
        answers={
            "learnHome": 0, "goToHome": 0, "goToPosition": 0, "isDataAvailable": False,
            "getRobotPosition": [0.0, 0.0, 0.0], "getRobotOrientation": [0.0, 0.0], "save": 0,
            "load": 0, "clear": 0,
        },
        does="stopAll",
    ),
    # The machine.
    "ALBattery": Quiet(
        answers={"getBatteryCharge": lambda battery: int(battery._nao.charge())},
        does="enablePowerMonitoring",
    ),
    "ALConnectionManager": Quiet(
        {"NetworkName": ""},
        {"state": "online", "services": [], "technologies": ["ethernet"]},
        "scan connect disconnect forget",
    ),
    "ALLogger": Quiet(
        {"Verbosity": "info"}, does="debug error fatal info verbose warn logInFile logInForwarder"
    ),
    "ALPreferenceManager": Quiet(
        {"Value": None},
        {"getDomainList": [], "getValueList": []},
        "update removeValue removeDomainValues",
    ),
    "ALResourceManager": Quiet(
        answers={"areResourcesFree": True, "areResourcesOwnedBy": False, "isResourceFree": True},
        does="acquireResource acquireResourcesTree releaseResource releaseResources "
        "waitForResource",
    ),
    "ALUserSession": Quiet(
        {"Focus": -1},
        {"getOpenUserSessions": [], "getNumUsers": 0, "getUserList": [], "doUsersExist": False},
    ),
}  # fmt: skip

EFFECTORS = Quiet(
    {
        "setFallManagerEnabled/getFallManagerEnabled": True,
        "setSmartStiffnessEnabled/getSmartStiffnessEnabled": True,
        "setPushRecoveryEnabled/getPushRecoveryEnabled": True,
        "setDiagnosisEffectEnabled/getDiagnosisEffectEnabled": True,
        "setBreathEnabled/getBreathEnabled": False,
        "setCollisionProtectionEnabled/getCollisionProtectionEnabled": True,
        "setExternalCollisionProtectionEnabled/getExternalCollisionProtectionEnabled": True,
        "setIdlePostureEnabled/getIdlePostureEnabled": False,
        "OrthogonalSecurityDistance": 0.4,
        "TangentialSecurityDistance": 0.1,
        "BreathConfig": [["Bpm", 12.0], ["Amplitude", 0.5]],
    },
    {
        "wbGoToBalance": True,
        "getMotionCycleTime": 20,
        "getFootSteps": [[], [], []],
        "getMass": 5.3,
        "areResourcesAvailable": True,
        "killTask": False,
    },
    does="setMotionConfig setPosition setPositions changePosition setTransform setTransforms "
    "changeTransform "
    "wbEnable wbFootState wbEnableBalanceConstraint wbEnableEffectorControl wbSetEffectorControl "
    "wbEnableEffectorOptimization setFootSteps setFootStepsWithSpeed killTasksUsingResources",
)
"""Of ALMotion: reflexes, safety, effectors, balance and single steps."""

TABLET = Quiet(
    {"Brightness": 1.0, "Volume": 7, "BackgroundColor": "#000000"},
    {
        **dict.fromkeys(
            (
                *("showImage", "showImageNoCache", "preLoadImage", "hideImage", "showWebview"),
                *("hideWebview", "loadUrl", "loadApplication", "playVideo", "pauseVideo"),
                *("resumeVideo", "stopVideo", "configureWifi", "connectWifi", "showInputDialog"),
            ),
            True,
        ),
        "robotIp": "198.18.0.1",
        "getWifiStatus": "IDLE",
        "version": "1.0",
        "getVideoLength": -1,
        "getVideoPosition": -1,
        "getOnTouchScaleFactor": 1.34,
        "enableWifi": None,
    },
    "cleanWebview reloadPage executeJS goToSleep wakeUp turnScreenOn resetTablet hide hideDialog "
    "setOnTouchWebviewScaleFactor pauseGif resumeGif disableWifi",
)
"""Of Pepper's ALTabletService."""

HEARD = {
    "WordRecognized": ["", -3.0],
    "WordRecognizedAndGrammar": ["", -3.0],
    "LastWordRecognized": "",
    "SpeechDetected": 0,
    "SoundDetected": [],
    "ALSoundLocalization/SoundLocated": [],
    "LandmarkDetected": [],
    "redBallDetected": [],
    "PictureDetected": [],
    "BarcodeReader/BarcodeDetected": [],
    "MovementDetection/MovementInfo": [],
    "DarknessDetection/DarknessValue": 0,
    "PeoplePerception/PeopleList": [],
    "PeoplePerception/VisiblePeopleList": [],
    "PeoplePerception/PeopleDetected": [],
    "EngagementZones/PersonApproached": 0,
    "Dialog/LastInput": "",
    "Dialog/Answered": "",
}
"""What ALMemory holds of them while nobody is there."""
