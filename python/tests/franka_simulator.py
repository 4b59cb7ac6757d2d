"""A simulated Franka arm that speaks Franka's control protocol, for `cargo xtask test real`.

The simulator is franky-sim, another project's: the protocol, the physics and the model of the FR3 are its own. Three
things are ours:

- Its answer to `Connect` puts the version behind a status of two bytes; the protocol has a status of one byte. libfranka
  does not look at the version of a successful answer, franka-rs does. The bytes are put where the protocol has them.
- franky-sim simulates no reflexes. With `--post`, a post stands between the fingers, and a force on it beyond
  `REFLEX_N` stops the arm as a Cartesian reflex does, until automatic error recovery.
- With `--drop N`, N states in a row are not sent, once a second.

Usage: python franka_simulator.py HOST [--post] [--drop N]; prints `ready` once it listens.
"""

import argparse
import struct
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
from franky_sim import SimulationServer, franka_robot_protocol, franka_server, simulation_server
from franky_sim.franka_robot_protocol import MoveStatus, RobotCommand, RobotMode
from franky_sim.franka_robot_server import FrankaRobotServer
from franky_sim.mujoco_simulator import MujocoSimulator

REFLEX_N = 40.0
"""Force on the post that stops the arm, N: in the range of the thresholds in Franka's own examples."""
CARTESIAN_REFLEX = 7
"""Number of the error in the protocol."""
POST = {"size": "0.015 0.015 0.265", "pos": "0.5545 0 0.265"}
"""Half sizes and centre of the post, m: 3 cm wide, up to the fingertips where the arm starts."""


class Connect(franka_server.ConnectCommand):
    """Connection whose answer has the bytes of the protocol: for the arm a status of one byte."""

    def handle(self, server, command_type_struct="I"):
        if server.udp_connected:
            return
        header = franka_server.MessageHeader(self.command_type, self.command_id, 8)
        layout = "<BH5x" if command_type_struct == "I" else "<HH4x"
        answer = struct.pack(layout, franka_server.ConnectStatus.kSuccess.value, server.library_version)
        self.client_socket.sendall(header.to_bytes(command_type_struct=command_type_struct) + answer)
        server._setup_udp_connection(self.network_udp_port)


class Recovery(franka_robot_protocol.AutomaticErrorRecoveryCommand):
    """Recovery that ends a reflex."""

    def handle(self, server):
        server.has_reflex = False
        super().handle(server)


class Server(FrankaRobotServer):
    """Server of the arm with reflexes and lost states."""

    drop = 0

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.has_reflex = False
        self.ticks = 0
        commands = self._FrankaServer__command_class_map
        commands[franka_server.Command.kConnect] = Connect
        commands[RobotCommand.kAutomaticErrorRecovery] = Recovery

    def _bind_children(self, hostname):
        super()._bind_children(hostname)
        self.gripper_server._FrankaServer__command_class_map[franka_server.Command.kConnect] = Connect

    def start_motion(self, *arguments):
        if self.has_reflex:
            raise RuntimeError("a reflex is to be recovered first")
        super().start_motion(*arguments)

    def stop_by_reflex(self):
        """Stop the arm where it is, as a reflex does."""
        if self.has_reflex:
            return
        self.has_reflex = True
        motion = self.current_motion_id
        self.stop_motion(send_preemption_signal=False)
        self._FrankaRobotServer__holding_q = tuple(self.robot.inner_state.q)
        if motion:
            franka_server.BaseCommand.send_response(
                self._tcp_socket, RobotCommand.kMove, motion, MoveStatus.kReflexAborted
            )
            self.reset_current_motion_id()

    @property
    def robot_state(self):
        state = super().robot_state
        if not self.has_reflex:
            return state
        errors = tuple(number == CARTESIAN_REFLEX for number in range(41))
        return state.replace(robot_mode=RobotMode.kReflex, errors=errors, reflex_reason=errors)

    def send_state(self):
        self.ticks += 1
        if self.ticks % 1000 < self.drop:
            # The state is lost on its way: its number is used up.
            self._FrankaServer__message_id += 1
            return
        super().send_state()


def force_on(simulator, name):
    """Sum of all contact forces on a shape, N: fingers that press it from both sides cancel."""
    model, data = simulator.model, simulator.data
    geom, total, one = model.geom(name).id, np.zeros(3), np.zeros(6)
    for number in range(data.ncon):
        contact = data.contact[number]
        if geom in (contact.geom1, contact.geom2):
            mujoco.mj_contactForce(model, data, number, one)
            force = contact.frame.reshape(3, 3).T @ one[:3]
            total += force if contact.geom2 == geom else -force
    return float(np.linalg.norm(total))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("host")
    parser.add_argument("--post", action="store_true")
    parser.add_argument("--drop", type=int, default=0)
    arguments = parser.parse_args()
    Server.drop = arguments.drop
    simulation_server.FrankaRobotServer = Server
    with MujocoSimulator() as simulator:
        simulator.add_robot(initial_hand_width=0.08)
        if arguments.post:
            ElementTree.SubElement(simulator.worldbody, "geom", name="post", type="box", **POST)
        with SimulationServer(simulator, hostname_candidates=[arguments.host]) as server:
            if arguments.post:
                [robot] = server.robot_servers
                simulator.register_post_step_callback(
                    lambda _: robot.stop_by_reflex() if force_on(simulator, "post") > REFLEX_N else None
                )
            print("ready", flush=True)
            try:
                server.run_forever()
            except KeyboardInterrupt:
                pass


if __name__ == "__main__":
    main()
