// Table, working area, light, cameras' frustums and outlines.

import {
  BackSide,
  BoxGeometry,
  BufferGeometry,
  Color,
  DirectionalLight,
  Float32BufferAttribute,
  Group,
  HemisphereLight,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshPhongMaterial,
  Quaternion,
  ShaderMaterial,
  Vector2,
  type Vector3,
  type Object3D,
  type PerspectiveCamera,
} from "three";
import type { Camera, Pose, Scene } from "../contract.ts";

export function setPose(object: Object3D, pose: Pose): void {
  const [w, x, y, z] = pose.orientation_wxyz;
  object.position.set(...pose.position_m);
  object.quaternion.set(x, y, z, w);
}

export interface Palette {
  background: string;
  table: string;
  line: string;
  accent: string;
  muted: string;
  danger: string;
  warning: string;
}

/** Colours of the page's theme. */
export function readPalette(element: Element): Palette {
  const style = getComputedStyle(element);
  const read = (name: string) => style.getPropertyValue(`--${name}`).trim();
  return {
    background: read("scene"),
    table: read("scene-table"),
    line: read("scene-line"),
    accent: read("accent-strong"),
    muted: read("scene-muted"),
    danger: read("danger-strong"),
    warning: read("warning-strong"),
  };
}

export class Lights extends Group {
  readonly sun = new DirectionalLight(0xffffff, 1.9);

  constructor() {
    super();
    const sky = new HemisphereLight(0xffffff, 0xb8b2a8, 1.95);
    sky.position.set(0, 0, 1);
    this.sun.position.set(1.4, 0.9, 2.6);
    this.sun.target.position.set(0.5, 0, 0);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(1024, 1024);
    const box = this.sun.shadow.camera;
    [box.left, box.right, box.top, box.bottom, box.near, box.far] = [-1, 1, 1, -1, 0.5, 5];
    this.sun.shadow.bias = -0.0006;
    this.sun.shadow.normalBias = 0.003;
    this.sun.shadow.radius = 3;
    this.add(sky, this.sun, this.sun.target);
  }
}

/** Slabs of the surfaces, a grid of 10 cm on the first and the outline of the working area. */
export class Furniture extends Group {
  // The same kind of material as the objects: one shader less to compile.
  private slab = new MeshPhongMaterial({ shininess: 4, specular: 0x050505 });
  private lines = new LineBasicMaterial({ transparent: true, opacity: 0.55 });
  private outline = new LineBasicMaterial({ transparent: true, opacity: 0.9 });

  show(scene: Scene, palette: Palette): void {
    this.clearAll();
    this.paint(palette);
    for (const surface of scene.surfaces) {
      const [width, depth, thickness] = surface.size_m;
      const slab = new Mesh(new BoxGeometry(width, depth, thickness), this.slab);
      const [x, y, z] = surface.center_m;
      slab.position.set(x, y, z - thickness / 2 - 0.0005);
      slab.rotation.z = surface.yaw_rad ?? 0;
      slab.receiveShadow = true;
      this.add(slab);
    }
    const { x, y } = scene.workspace;
    const top = (scene.surfaces[0]?.center_m[2] ?? 0) + 0.0008;
    const points: number[] = [];
    const steps = (from: number, to: number) => Array.from({ length: Math.round((to - from) * 10) + 1 }, (_, index) => from + index / 10);
    for (const at of steps(x[0], x[1])) points.push(at, y[0], top, at, y[1], top);
    for (const at of steps(y[0], y[1])) points.push(x[0], at, top, x[1], at, top);
    this.add(new LineSegments(lineGeometry(points), this.lines));
    const border = [x[0], y[0], top, x[1], y[0], top, x[1], y[0], top, x[1], y[1], top, x[1], y[1], top, x[0], y[1], top, x[0], y[1], top, x[0], y[0], top];
    this.add(new LineSegments(lineGeometry(border), this.outline));
  }

  paint(palette: Palette): void {
    this.slab.color.set(palette.table);
    this.lines.color.set(palette.line);
    this.outline.color.set(palette.muted);
  }

  private clearAll(): void {
    for (const child of [...this.children]) {
      (child as Mesh).geometry.dispose();
      this.remove(child);
    }
  }
}

function lineGeometry(points: number[]): BufferGeometry {
  return new BufferGeometry().setAttribute("position", new Float32BufferAttribute(points, 3));
}

/** Frustums of the cameras; each has a small body that can be clicked. */
export class Frustums extends Group {
  private body = new BoxGeometry(0.045, 0.03, 0.03);

  show(cameras: Camera[], selected: string | null, looking: string | null, palette: Palette): void {
    this.clearAll();
    for (const camera of cameras) {
      if (camera.name === looking) continue;
      const isSelected = camera.name === selected;
      const color = new Color(isSelected ? palette.accent : palette.muted);
      const group = new Group();
      setPose(group, camera.world_from_camera);
      const { width, height, fx, fy, cx, cy } = camera.intrinsics;
      const far = isSelected ? 0.22 : 0.1;
      const corner = (u: number, v: number) => [((u - cx) / fx) * far, ((v - cy) / fy) * far, far];
      const corners = [corner(-0.5, -0.5), corner(width - 0.5, -0.5), corner(width - 0.5, height - 0.5), corner(-0.5, height - 0.5)];
      const points = corners.flatMap((at, index) => [0, 0, 0, ...at, ...at, ...corners[(index + 1) % 4]!]);
      // A tick above the upper edge shows which way the image is up.
      const [left, right] = corners as [number[], number[]];
      const middle = [(left[0]! + right[0]!) / 2, left[1]!, far];
      points.push(...left, middle[0]!, middle[1]! - far * 0.16, far, middle[0]!, middle[1]! - far * 0.16, far, ...right);
      const material = new LineBasicMaterial({ color, transparent: true, opacity: isSelected ? 1 : 0.75 });
      const body = new Mesh(this.body, new MeshBasicMaterial({ color, toneMapped: false }));
      body.userData["camera"] = camera.name;
      group.add(new LineSegments(lineGeometry(points), material), body);
      this.add(group);
    }
  }

  /** A frustum in front of the eye would only be lines across the image. */
  hideNear(eye: Vector3): void {
    for (const group of this.children) group.visible = group.position.distanceTo(eye) > 0.5;
  }

  private clearAll(): void {
    for (const group of [...this.children]) {
      group.traverse((object) => {
        if (object instanceof LineSegments) object.geometry.dispose();
        if (object instanceof LineSegments || object instanceof Mesh) (object.material as LineBasicMaterial).dispose();
      });
      this.remove(group);
    }
  }
}

/** Projection of a dataset camera, and its pose with the axes of OpenGL. */
export function lookThroughCamera(target: PerspectiveCamera, camera: Camera): void {
  setPose(target, camera.world_from_camera);
  target.quaternion.multiply(new Quaternion(1, 0, 0, 0));
  const { width, height, fx, fy, cx, cy } = camera.intrinsics;
  const [near, far] = [0.01, 20];
  target.projectionMatrix.copy(
    new Matrix4().set(
      (2 * fx) / width, 0, 1 - (2 * (cx + 0.5)) / width, 0,
      0, (2 * fy) / height, (2 * (cy + 0.5)) / height - 1, 0,
      0, 0, -(far + near) / (far - near), (-2 * far * near) / (far - near),
      0, 0, -1, 0,
    ),
  );
  target.projectionMatrixInverse.copy(target.projectionMatrix).invert();
  target.updateMatrixWorld(true);
}

/** Back faces pushed outwards by some pixels: an outline that needs no second pass. */
export function outlineMaterial(resolution: Vector2): ShaderMaterial {
  return new ShaderMaterial({
    side: BackSide,
    uniforms: { color: { value: new Color() }, pixels: { value: 2.5 }, resolution: { value: resolution } },
    vertexShader: `
      uniform float pixels;
      uniform vec2 resolution;
      void main() {
        vec4 at = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
        vec2 out_ = (projectionMatrix * vec4(normalMatrix * normal, 0.0)).xy;
        float size = length(out_ * resolution);
        if (size > 1e-6) at.xy += out_ * resolution / size * pixels * 2.0 / resolution * at.w;
        gl_Position = at;
      }`,
    fragmentShader: `
      uniform vec3 color;
      void main() {
        gl_FragColor = vec4(color, 1.0);
        #include <colorspace_fragment>
      }`,
  });
}
