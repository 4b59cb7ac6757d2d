"""Renders a scene that `genmanip-lab render --baselines` wrote, with MuJoCo's renderer and with PyBullet's TinyRenderer.

    python3 -m venv renderers && renderers/bin/pip install mujoco==3.17.0 pybullet==3.2.7 numpy
    genmanip-lab render --baselines --python renderers/bin/python --json

The subcommand runs this script with the folder of the scene; it prints one JSON object.  An engine that cannot be imported
or that fails is `null`, with the reason in `problems`.  MuJoCo's renderer needs OpenGL without a display: EGL (Debian:
libegl1, libgl1-mesa-dri) or, with MUJOCO_GL=osmesa, OSMesa (libosmesa6).

Both engines render all triangles in plain colours, without textures, and one directional light with shadows.
Milliseconds are CPU time of all threads of this process, medians after two warm-up images.
"""

import json
import os
import pathlib
import resource
import statistics
import sys

import numpy as np

ROUNDS = 9
SHADOW_TEXELS = 1024
NEAR_M, FAR_M = 0.05, 20.0


def main():
    folder = pathlib.Path(sys.argv[1])
    scene = json.loads((folder / "scene.json").read_text())
    for mesh in scene["meshes"]:
        mesh["positions"] = np.fromfile(folder / f"{mesh['file']}.f32", "<f4").reshape(-1, 3)
        mesh["triangles"] = np.fromfile(folder / f"{mesh['file']}.u32", "<u4").reshape(-1, 3)
    size = (scene["camera"]["height"], scene["camera"]["width"])
    depth = np.fromfile(folder / "depth.f32", "<f4").reshape(size)
    ids = np.fromfile(folder / "ids.u16", "<u2").reshape(size)
    report = {"problems": []}
    for name, measure in [("mujoco", with_mujoco), ("pybullet", with_pybullet)]:
        try:
            report[name] = measure(scene, depth, ids, folder)
        except Exception as error:  # a failing engine must not stop the other
            report[name] = None
            report["problems"].append(f"{name}: {type(error).__name__}: {error}")
    # PyBullet logs to standard output from C: the report is the last line.
    print(json.dumps(report))


def cpu_s():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def median_ms(draw):
    draw(), draw()
    times = []
    for _ in range(ROUNDS):
        start = cpu_s()
        draw()
        times.append((cpu_s() - start) * 1e3)
    return statistics.median(times)


def difference(own_depth, own_ids, depth_m, ids):
    """How depth and ids differ; depth where both see the same thing."""
    same = (own_ids == ids) & (ids > 0)
    apart = np.abs(own_depth[same] - depth_m[same])
    return {
        "ids_differ_share": float(np.mean(own_ids != ids)),
        "depth_median_mm": float(np.median(apart) * 1e3),
        "depth_p99_9_mm": float(np.quantile(apart, 0.999) * 1e3),
    }


def with_mujoco(scene, own_depth, own_ids, _folder):
    os.environ.setdefault("MUJOCO_GL", "egl")
    import mujoco
    from OpenGL import GL

    camera = scene["camera"]
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = camera["width"], camera["height"]
    spec.visual.quality.shadowsize, spec.visual.quality.offsamples = SHADOW_TEXELS, 4
    spec.stat.extent, spec.stat.center = 1.0, scene["center"]
    spec.visual.map.znear, spec.visual.map.zfar = NEAR_M, FAR_M
    spec.worldbody.add_light(
        pos=np.array(scene["center"]) + 2.0 * np.array(scene["to_light"]),
        dir=-np.array(scene["to_light"]),
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        castshadow=True,
    )
    for index, mesh in enumerate(scene["meshes"]):
        spec.add_mesh(
            name=f"m{index}",
            uservert=mesh["positions"].ravel(),
            userface=mesh["triangles"].ravel().astype(np.int32),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        spec.worldbody.add_geom(
            name=f"g{index}",
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=f"m{index}",
            rgba=[*mesh["color"], 1.0],
            contype=0,
            conaffinity=0,
        )
    turn = np.array(camera["rotation"]) @ np.diag([1.0, -1.0, -1.0])
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, turn.ravel())
    fovy = np.degrees(2.0 * np.arctan(0.5 * camera["height"] / camera["fy"]))
    spec.worldbody.add_camera(name="camera", pos=camera["position"], quat=quat, fovy=fovy)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, camera["height"], camera["width"]) as renderer:
        renderer.update_scene(data, "camera")
        gl = {"renderer": GL.glGetString(GL.GL_RENDERER).decode(), "version": GL.glGetString(GL.GL_VERSION).decode()}
        rgb_ms = median_ms(renderer.render)
        renderer.enable_depth_rendering()
        depth_ms = median_ms(renderer.render)
        renderer.disable_depth_rendering()
        renderer.enable_segmentation_rendering()
        ids_ms = median_ms(renderer.render)
        renderer.disable_segmentation_rendering()
        # The engine leaves faces away that look away; open meshes show theirs here.
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = 0
        renderer.enable_depth_rendering()
        depth_m = renderer.render().copy()
        renderer.disable_depth_rendering()
        renderer.enable_segmentation_rendering()
        geoms = renderer.render()[:, :, 0].copy()
    instances = np.array([mesh["instance"] for mesh in scene["meshes"]] + [0])
    return {
        "version": mujoco.__version__,
        "gl_backend": os.environ["MUJOCO_GL"],
        "gl": gl,
        "ms": rgb_ms + depth_ms + ids_ms,
        "rgb_ms": rgb_ms,
        "depth_ms": depth_ms,
        "ids_ms": ids_ms,
        "difference": difference(own_depth, own_ids, depth_m, instances[geoms]),
    }


def with_pybullet(scene, own_depth, own_ids, folder):
    from importlib.metadata import version

    import pybullet

    camera = scene["camera"]
    client = pybullet.connect(pybullet.DIRECT)
    bodies = {}
    for index, mesh in enumerate(scene["meshes"]):
        file = folder / f"{index}.obj"
        corners = "".join(f"v {x:.7f} {y:.7f} {z:.7f}\n" for x, y, z in mesh["positions"])
        faces = "".join(f"f {a} {b} {c}\n" for a, b, c in mesh["triangles"] + 1)
        file.write_text(corners + faces)
        shape = pybullet.createVisualShape(pybullet.GEOM_MESH, fileName=str(file), rgbaColor=[*mesh["color"], 1.0])
        bodies[pybullet.createMultiBody(baseVisualShapeIndex=shape)] = mesh["instance"]
    turn = np.array(camera["rotation"]) @ np.diag([1.0, -1.0, -1.0])
    view = np.eye(4)
    view[:3, :3] = turn.T
    view[:3, 3] = -turn.T @ np.array(camera["position"])
    fovy = np.degrees(2.0 * np.arctan(0.5 * camera["height"] / camera["fy"]))
    projection = pybullet.computeProjectionMatrixFOV(fovy, camera["width"] / camera["height"], NEAR_M, FAR_M)

    def draw():
        return pybullet.getCameraImage(
            camera["width"],
            camera["height"],
            view.T.ravel().tolist(),
            projection,
            lightDirection=scene["to_light"],
            shadow=1,
            renderer=pybullet.ER_TINY_RENDERER,
        )

    ms = median_ms(draw)
    depth, seen = (np.asarray(part) for part in draw()[3:5])
    pybullet.disconnect(client)
    depth = depth.reshape(own_depth.shape).astype(np.float64)
    depth_m = FAR_M * NEAR_M / (FAR_M - (FAR_M - NEAR_M) * depth)
    seen = seen.reshape(own_ids.shape)
    ids = np.zeros_like(own_ids)
    for body, instance in bodies.items():
        ids[seen == body] = instance
    return {
        "version": version("pybullet"),
        "gl_backend": "none: TinyRenderer",
        "ms": ms,
        "difference": difference(own_depth, own_ids, depth_m, ids),
    }


if __name__ == "__main__":
    main()
