"""Files of Pixar's USD library with what it says of them: extents of links, ranges of joints, masses.

`interop_usd.py FOLDER SEED` writes 30 files and `expected.json`: one object per file, of one to four links.
`interop_usd.py SCENE.usda SCENARIO.json` checks what `genmanip export --usd` made of a scenario.
"""

import json
import math
import random
import shutil
import sys
from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdPhysics, UsdUtils

COUNT = 30
ROTATIONS = ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"]


class Maker:
    """One object under construction."""

    def __init__(self, number: int, seed: int, folder: Path):
        self.rng = random.Random(1000 * seed + number)
        self.number, self.folder = number, folder
        self.metres = self.rng.choice([1.0, 0.01, 0.001])
        self.kilograms = self.rng.choice([1.0, 0.001])
        self.up = self.rng.choice(["Y", "Z"])
        self.name = f"object_{number:02d}"
        self.ending = ["usda", "usdc", "usdz"][number % 3]
        self.stage = self.layer(self.name, "usda" if self.ending == "usda" else "usdc")
        self.has_parts_beside = number % 5 == 4

    def layer(self, name: str, ending: str) -> Usd.Stage:
        stage = Usd.Stage.CreateNew(str(self.folder / f"{name}.{ending}"))
        UsdGeom.SetStageMetersPerUnit(stage, self.metres)
        UsdGeom.SetStageUpAxis(stage, self.up)
        UsdPhysics.SetStageKilogramsPerUnit(stage, self.kilograms)
        return stage

    def length(self, low: float, high: float) -> float:
        """Length in units of the stage between two in metres."""
        return self.rng.uniform(low, high) / self.metres

    def direction(self) -> Gf.Vec3d:
        return Gf.Vec3d(*(self.rng.gauss(0, 1) for _ in range(3))).GetNormalized()

    def rotation(self) -> Gf.Rotation:
        return Gf.Rotation(self.direction(), self.rng.uniform(-180, 180))

    def quat(self) -> Gf.Quatf:
        return Gf.Quatf(self.rotation().GetQuat())

    def place(self, prim: Usd.Prim, reach: float, scale: tuple | None) -> None:
        """Random operations: position, rotation in one of its forms, and a scale if given."""
        form = UsdGeom.Xformable(prim)
        offset = Gf.Vec3d(*(self.length(-reach, reach) for _ in range(3)))
        kind = self.rng.randrange(4)
        if kind == 0:
            matrix = Gf.Matrix4d().SetScale(Gf.Vec3d(*(scale or (1, 1, 1))))
            matrix *= Gf.Matrix4d().SetRotate(self.rotation()) * Gf.Matrix4d().SetTranslate(offset)
            form.AddTransformOp().Set(matrix)
            return
        form.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(offset)
        if kind == 1:
            form.AddOrientOp().Set(self.quat())
        elif kind == 2:
            order = self.rng.choice(ROTATIONS)
            angles = Gf.Vec3f(*(self.rng.uniform(-170, 170) for _ in range(3)))
            getattr(form, f"AddRotate{order}Op")().Set(angles)
        else:
            # About a pivot, as modelling programs write it.
            pivot = form.AddTranslateOp(UsdGeom.XformOp.PrecisionFloat, "pivot")
            pivot.Set(Gf.Vec3f(*(self.length(-0.05, 0.05) for _ in range(3))))
            form.AddRotateZOp().Set(self.rng.uniform(-170, 170))
            form.AddRotateXOp().Set(self.rng.uniform(-80, 80))
            form.AddTranslateOp(UsdGeom.XformOp.PrecisionFloat, "pivot", True)
        if scale:
            form.AddScaleOp().Set(Gf.Vec3f(*scale))

    def shape(self, stage: Usd.Stage, path: str) -> None:
        """A collider of one of the forms; curved ones are scaled evenly."""
        kind = self.rng.choice(["Mesh", "Mesh", "Cube", "Sphere", "Cylinder", "Capsule"])
        even = self.rng.uniform(0.5, 1.5)
        scale = (even, even, even)
        if kind == "Mesh":
            mesh = UsdGeom.Mesh.Define(stage, path)
            half = [self.length(0.01, 0.05) for _ in range(3)]
            signs = np.ndindex(2, 2, 2)
            mesh.CreatePointsAttr([Gf.Vec3f(*((2 * s - 1) * h for s, h in zip(three, half))) for three in signs])
            mesh.CreateFaceVertexCountsAttr([4] * 6)
            faces = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]
            if self.rng.random() < 0.3:
                mesh.CreateOrientationAttr("leftHanded")
                faces = faces[::-1]
            mesh.CreateFaceVertexIndicesAttr(faces)
            mesh.CreateSubdivisionSchemeAttr("none")
            UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr("convexHull")
            scale = tuple(self.rng.uniform(0.5, 1.5) for _ in range(3))
        elif kind == "Cube":
            UsdGeom.Cube.Define(stage, path).CreateSizeAttr(self.length(0.03, 0.08))
            scale = tuple(self.rng.uniform(0.5, 1.5) for _ in range(3))
        elif kind == "Sphere":
            UsdGeom.Sphere.Define(stage, path).CreateRadiusAttr(self.length(0.02, 0.05))
        else:
            shape = getattr(UsdGeom, kind).Define(stage, path)
            shape.CreateRadiusAttr(self.length(0.01, 0.03))
            shape.CreateHeightAttr(self.length(0.03, 0.1))
            shape.CreateAxisAttr(self.rng.choice("XYZ"))
        prim = stage.GetPrimAtPath(path)
        self.place(prim, 0.06, scale)
        UsdPhysics.CollisionAPI.Apply(prim)

    def body(self, path: str, reach: float) -> Usd.Prim:
        body = UsdGeom.Xform.Define(self.stage, path).GetPrim()
        even = self.rng.choice([1.0, 1.0, 2.0])
        self.place(body, reach, None if even == 1.0 else (even, even, even))
        UsdPhysics.RigidBodyAPI.Apply(body)
        mass = UsdPhysics.MassAPI.Apply(body)
        mass.CreateMassAttr(self.rng.uniform(0.05, 2.0) / self.kilograms)
        group = UsdGeom.Xform.Define(self.stage, f"{path}/group").GetPrim()
        self.place(group, 0.03, None)
        for number in range(self.rng.randrange(1, 3)):
            self.shape(self.stage, f"{path}/group/shape_{number}")
        if self.has_parts_beside:
            # Geometry in a layer of its own, shared by instances.
            name = f"{self.name}_{body.GetName()}_part"
            part = self.layer(name, "usda")
            root = UsdGeom.Xform.Define(part, "/part").GetPrim()
            part.SetDefaultPrim(root)
            self.shape(part, "/part/more")
            part.GetRootLayer().Save()
            for number in range(2):
                held = UsdGeom.Xform.Define(self.stage, f"{path}/copy_{number}").GetPrim()
                self.place(held, 0.08, None)
                arcs = held.GetPayloads() if number else held.GetReferences()
                (arcs.AddPayload if number else arcs.AddReference)(f"./{name}.usda")
                held.SetInstanceable(True)
        return body

    def joint(self, kind: str, name: str, first: Usd.Prim, second: Usd.Prim) -> dict:
        """A joint at a random place; the second body is in the file where the joint is not at 0."""
        joint = getattr(UsdPhysics, f"{kind}Joint").Define(self.stage, f"/{self.name}/joints/{name}")
        # Some joints have the base as their second body.
        is_turned = self.rng.random() < 0.3
        first, second = (second, first) if is_turned else (first, second)
        joint.CreateBody0Rel().SetTargets([first.GetPath()])
        joint.CreateBody1Rel().SetTargets([second.GetPath()])
        axis = self.rng.choice("XYZ")
        along = {"X": Gf.Vec3d(1, 0, 0), "Y": Gf.Vec3d(0, 1, 0), "Z": Gf.Vec3d(0, 0, 1)}[axis]
        limits, motion = None, Gf.Matrix4d(1)
        if kind == "Revolute":
            limits = [self.rng.uniform(-90, -10), self.rng.uniform(10, 120)]
            motion.SetRotate(Gf.Rotation(along, self.rng.uniform(-30, 30)))
        elif kind == "Prismatic":
            limits = [self.length(-0.1, -0.02), self.length(0.02, 0.2)]
            motion.SetTranslate(along * self.length(-0.05, 0.05))
        if limits:
            joint.CreateAxisAttr(axis)
            joint.CreateLowerLimitAttr(limits[0])
            joint.CreateUpperLimitAttr(limits[1])
            limits = [joint.GetLowerLimitAttr().Get(), joint.GetUpperLimitAttr().Get()]
        cache = UsdGeom.XformCache()
        frame = Gf.Matrix4d().SetRotate(self.rotation())
        frame *= Gf.Matrix4d().SetTranslate(Gf.Vec3d(*(self.length(-0.1, 0.1) for _ in range(3))))
        for side, (body, world) in enumerate(((first, frame), (second, motion * frame))):
            matrix = cache.GetLocalToWorldTransform(body)
            place = matrix.GetInverse().Transform(world.ExtractTranslation())
            turn = world.ExtractRotation() * matrix.RemoveScaleShear().ExtractRotation().GetInverse()
            getattr(joint, f"CreateLocalPos{side}Attr")(Gf.Vec3f(place))
            getattr(joint, f"CreateLocalRot{side}Attr")(Gf.Quatf(turn.GetQuat()))
        unit = math.pi / 180 if kind == "Revolute" else self.metres
        limits = limits and [limit * unit for limit in limits]
        return {"name": name, "kind": kind.lower(), "axis": axis, "range": limits, "prim": joint, "turned": is_turned}

    def make(self) -> dict:
        root = UsdGeom.Xform.Define(self.stage, f"/{self.name}").GetPrim()
        self.stage.SetDefaultPrim(root)
        Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
        self.place(root, 0.2, (0.5, 0.5, 0.5) if self.number % 4 == 1 else None)
        bodies = [self.body(f"/{self.name}/base", 0.1)]
        UsdPhysics.ArticulationRootAPI.Apply(bodies[0])
        UsdGeom.Scope.Define(self.stage, f"/{self.name}/joints")
        joints = []
        for number in range(1, 1 + self.number % 4):
            parent = self.rng.randrange(len(bodies))
            bodies.append(self.body(f"/{self.name}/part_{number}", 0.15))
            kind = self.rng.choice(["Revolute", "Revolute", "Prismatic", "Prismatic", "Fixed"])
            joint = self.joint(kind, f"joint_{number}", bodies[parent], bodies[number])
            joints.append({**joint, "parent": parent, "child": number})
        if self.number % 7 == 3:
            fixed = UsdPhysics.FixedJoint.Define(self.stage, f"/{self.name}/joints/to_world")
            fixed.CreateBody1Rel().SetTargets([bodies[0].GetPath()])
            matrix = UsdGeom.XformCache().GetLocalToWorldTransform(bodies[0])
            fixed.CreateLocalPos0Attr(Gf.Vec3f(matrix.ExtractTranslation()))
            fixed.CreateLocalRot0Attr(Gf.Quatf(matrix.RemoveScaleShear().ExtractRotation().GetQuat()))
        self.stage.GetRootLayer().Save()
        layer = Path(self.stage.GetRootLayer().realPath)
        expected = self.expected(layer, joints)
        if self.ending == "usdz":
            archive = layer.with_suffix(".usdz")
            assert UsdUtils.CreateNewUsdzPackage(str(layer), str(archive))
            layer.unlink()
            for part in self.folder.glob(f"{self.name}_*_part.usda"):
                part.unlink()
            layer = archive
        return {"file": layer.name, **expected}

    def expected(self, layer: Path, joints: list) -> dict:
        """What Pixar's library says when it opens the file again."""
        stage = Usd.Stage.Open(str(layer))
        cache = UsdGeom.XformCache()
        metres = UsdGeom.GetStageMetersPerUnit(stage)
        count = 1 + len(joints)
        names = ["base"] + [f"part_{joint['child']}" for joint in joints]
        bodies = [stage.GetPrimAtPath(f"/{self.name}/{name}") for name in names]
        poses = []
        for number in range(3):
            positions = {j["name"]: self.rng.uniform(*j["range"]) if number else 0.0 for j in joints if j["range"]}
            placed = [np.eye(4) for _ in bodies]
            link_of = list(range(count))
            for joint in joints:
                frames = []
                ends = (joint["parent"], joint["child"])
                for side, body in enumerate(ends[::-1] if joint["turned"] else ends):
                    prim = stage.GetPrimAtPath(joint["prim"].GetPath())
                    place = prim.GetAttribute(f"physics:localPos{side}").Get()
                    # In double precision; Gf.Rotation does not normalise, which matters for small angles.
                    turn = Gf.Quatd(prim.GetAttribute(f"physics:localRot{side}").Get())
                    turn = Gf.Rotation(turn.GetNormalized())
                    matrix = cache.GetLocalToWorldTransform(bodies[body])
                    turn = turn * matrix.RemoveScaleShear().ExtractRotation()
                    world = Gf.Matrix4d().SetRotate(turn)
                    world.SetTranslateOnly(matrix.Transform(Gf.Vec3d(place)))
                    frames.append(np.array(world).T)
                motion = np.eye(4)
                along = np.eye(3)["XYZ".index(joint["axis"])]
                value = positions.get(joint["name"], 0.0)
                if joint["kind"] == "revolute":
                    rotation = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(*along), math.degrees(value)))
                    motion = np.array(rotation).T
                elif joint["kind"] == "prismatic":
                    motion[:3, 3] = along * value / metres
                else:
                    link_of[joint["child"]] = link_of[joint["parent"]]
                first_from_second = frames[0] @ motion @ np.linalg.inv(frames[1])
                parent_from_child = np.linalg.inv(first_from_second) if joint["turned"] else first_from_second
                placed[joint["child"]] = placed[joint["parent"]] @ parent_from_child
            links = {}
            for index, body in enumerate(bodies):
                name = names[link_of[index]]
                low, high = self.extent(body, placed[index], cache, metres)
                if name in links:
                    low, high = np.minimum(low, links[name][0]), np.maximum(high, links[name][1])
                links[name] = (low, high)
            poses.append({"joints": positions, "links": {n: [list(a), list(b)] for n, (a, b) in links.items()}})
        masses = {}
        for index, body in enumerate(bodies):
            mass = UsdPhysics.MassAPI(body).GetMassAttr().Get() * UsdPhysics.GetStageKilogramsPerUnit(stage)
            name = names[link_of[index]]
            masses[name] = masses.get(name, 0.0) + mass
        moving = [{k: j[k] for k in ("name", "kind", "range")} for j in joints if j["range"]]
        return {"joints": moving, "masses_kg": masses, "poses": poses}

    def extent(self, body: Usd.Prim, placed: np.ndarray, cache: UsdGeom.XformCache, metres: float) -> tuple:
        """Extent of a body's shapes in metres, z up."""
        up = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) if self.up == "Y" else np.eye(3)
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for prim in Usd.PrimRange(body, Usd.TraverseInstanceProxies()):
            if not prim.IsA(UsdGeom.Gprim):
                continue
            matrix = placed @ np.array(cache.GetLocalToWorldTransform(prim)).T
            linear, center = metres * up @ matrix[:3, :3], metres * up @ matrix[:3, 3]
            kind = prim.GetTypeName()
            if kind == "Mesh":
                points = np.array(prim.GetAttribute("points").Get(), dtype=float) @ linear.T
                low, high = np.minimum(low, center + points.min(0)), np.maximum(high, center + points.max(0))
                continue
            if kind == "Cube":
                half = np.abs(linear).sum(1) * prim.GetAttribute("size").Get() / 2
            elif kind == "Sphere":
                half = np.linalg.norm(linear, axis=1) * prim.GetAttribute("radius").Get()
            else:
                along = "XYZ".index(prim.GetAttribute("axis").Get())
                radius, height = prim.GetAttribute("radius").Get(), prim.GetAttribute("height").Get()
                across = linear if kind == "Capsule" else np.delete(linear, along, axis=1)
                half = np.abs(linear[:, along]) * height / 2 + np.linalg.norm(across, axis=1) * radius
            low, high = np.minimum(low, center - half), np.maximum(high, center + half)
        return low, high


def check(scene: Path, scenario: dict) -> None:
    """Poses, bodies, masses, cameras and textures of an exported scenario, by Pixar's library."""
    stage = Usd.Stage.Open(str(scene))
    assert not stage.GetCompositionErrors()
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1 and UsdGeom.GetStageUpAxis(stage) == "Z"
    cache = UsdGeom.XformCache()
    for placed in scenario["objects"]:
        prims = [p for p in stage.Traverse() if p.GetAttribute("genmanip:id").Get() == placed["id"]]
        assert len(prims) == 1, placed["id"]
        matrix = cache.GetLocalToWorldTransform(prims[0])
        off = np.abs(np.array(matrix.ExtractTranslation()) - placed["pose"]["position_m"]).max()
        turn = matrix.ExtractRotationQuat()
        quat = np.array([turn.GetReal(), *turn.GetImaginary()])
        off = max(off, 1 - abs(quat @ placed["pose"]["orientation_wxyz"]))
        assert off < 1e-6, (placed["id"], off)
        bodies = [p for p in Usd.PrimRange(prims[0]) if p.HasAPI(UsdPhysics.RigidBodyAPI)]
        assert bodies and all(UsdPhysics.MassAPI(body).GetMassAttr().Get() > 0 for body in bodies)
        colliders = [p for p in Usd.PrimRange(prims[0]) if p.HasAPI(UsdPhysics.CollisionAPI)]
        assert colliders, placed["id"]
    joints = [p for p in stage.Traverse() if p.IsA(UsdPhysics.Joint)]
    for joint in map(UsdPhysics.Joint, joints):
        # Both frames coincide but for the motion along or about x.
        frames = []
        for side in (0, 1):
            body = getattr(joint, f"GetBody{side}Rel")().GetTargets()
            matrix = cache.GetLocalToWorldTransform(stage.GetPrimAtPath(body[0])) if body else Gf.Matrix4d(1)
            local = Gf.Matrix4d().SetRotate(getattr(joint, f"GetLocalRot{side}Attr")().Get())
            local.SetTranslateOnly(Gf.Vec3d(getattr(joint, f"GetLocalPos{side}Attr")().Get()))
            frames.append(local * matrix)
        between = frames[1] * frames[0].GetInverse()
        moved, turned = between.ExtractTranslation(), between.ExtractRotationQuat().GetImaginary()
        kind = joint.GetPrim().GetTypeName()
        rest = [*moved[1:], *turned[1:]] + ([moved[0]] if kind != "PhysicsPrismaticJoint" else [])
        rest += [turned[0]] if kind != "PhysicsRevoluteJoint" else []
        assert max(map(abs, rest)) < 1e-5, (joint.GetPath(), moved, turned)
    cameras = {p.GetName(): p for p in stage.Traverse() if p.IsA(UsdGeom.Camera)}
    for camera in scenario["world"]["cameras"]:
        seen = camera["intrinsics"]
        window = UsdGeom.Camera(cameras[camera["name"]]).GetCamera(Usd.TimeCode.Default()).frustum.window
        wanted = [
            (-0.5 - seen["cx"]) / seen["fx"],
            (seen["cy"] - seen["height"] + 0.5) / seen["fy"],
            (seen["width"] - 0.5 - seen["cx"]) / seen["fx"],
            (seen["cy"] + 0.5) / seen["fy"],
        ]
        off = np.abs(np.array([*window.min, *window.max]) - wanted).max()
        assert off < 1e-6, (camera["name"], off)
    for prim in stage.Traverse():
        if (asset := prim.GetAttribute("inputs:file").Get()) is not None:
            assert asset.resolvedPath, asset
    print(f"{scene.name}: {len(scenario['objects'])} objects, {len(joints)} joints, as in the scenario")


def main() -> None:
    folder = Path(sys.argv[1])
    if folder.suffix == ".usda":
        check(folder, json.loads(Path(sys.argv[2]).read_text()))
        return
    seed = int(sys.argv[2])
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    files = [Maker(number, seed, folder).make() for number in range(COUNT)]
    text = json.dumps({"usd": Usd.GetVersion(), "seed": seed, "files": files}, indent=None)
    (folder / "expected.json").write_text(text.replace('{"file"', '\n{"file"') + "\n")


main()
