"""A virtual NAO or Pepper: NAOqi's services on a real libqi session."""

from doorway3ds.lab.sim.robot.nao.robot import Faults, VirtualNao

__all__ = ["Faults", "VirtualNao"]
