// Reader of the server's meshes: GLB with one mesh per file, no animation, no skin, no nested nodes.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DoubleSide,
  FrontSide,
  Group,
  Mesh,
  MeshPhongMaterial,
  RepeatWrapping,
  SRGBColorSpace,
  Texture,
} from "three";

interface Document {
  nodes?: { mesh?: number }[];
  meshes?: { primitives: { attributes: Record<string, number>; indices?: number; material?: number }[] }[];
  accessors?: { bufferView: number; byteOffset?: number; componentType: number; count: number; type: string; normalized?: boolean }[];
  bufferViews?: { byteOffset?: number; byteLength: number }[];
  materials?: {
    doubleSided?: boolean;
    alphaMode?: string;
    pbrMetallicRoughness?: {
      baseColorFactor?: [number, number, number, number];
      metallicFactor?: number;
      roughnessFactor?: number;
      baseColorTexture?: { index: number };
    };
  }[];
  textures?: { source: number }[];
  images?: { bufferView: number; mimeType: string }[];
}

const JSON_CHUNK = 0x4e4f534a;
const SHAPES: Record<string, number> = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };

/** Objects of a file, in its own axes. */
export async function readGlb(bytes: ArrayBuffer): Promise<Group> {
  const view = new DataView(bytes);
  if (bytes.byteLength < 20 || view.getUint32(0, true) !== 0x46546c67) throw new Error("no GLB file");
  const length = view.getUint32(12, true);
  if (view.getUint32(16, true) !== JSON_CHUNK) throw new Error("a GLB file begins with its JSON");
  const document = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 20, length))) as Document;
  const binary = bytes.slice(28 + length);
  const textures = await Promise.all((document.textures ?? []).map(({ source }) => readTexture(document, binary, source)));
  const materials = (document.materials ?? []).map((material) => readMaterial(material, textures));
  const group = new Group();
  const plain = new MeshPhongMaterial({ color: 0xb0b0b0 });
  for (const node of document.nodes ?? []) {
    const primitives = node.mesh === undefined ? [] : (document.meshes?.[node.mesh]?.primitives ?? []);
    for (const primitive of primitives) {
      const geometry = new BufferGeometry();
      const attribute = (name: string, as: string) => {
        const index = primitive.attributes[name];
        if (index !== undefined) geometry.setAttribute(as, readAccessor(document, binary, index));
      };
      attribute("POSITION", "position");
      attribute("NORMAL", "normal");
      attribute("TEXCOORD_0", "uv");
      attribute("COLOR_0", "color");
      if (primitive.indices !== undefined) geometry.setIndex(readAccessor(document, binary, primitive.indices));
      if (!geometry.getAttribute("normal")) geometry.computeVertexNormals();
      geometry.computeBoundingSphere();
      const material = materials[primitive.material ?? -1] ?? plain;
      if (geometry.getAttribute("color")) material.vertexColors = true;
      group.add(new Mesh(geometry, material));
    }
  }
  return group;
}

function readAccessor(document: Document, binary: ArrayBuffer, index: number): BufferAttribute {
  const accessor = document.accessors![index]!;
  const start = (document.bufferViews![accessor.bufferView]!.byteOffset ?? 0) + (accessor.byteOffset ?? 0);
  const size = SHAPES[accessor.type]!;
  const count = accessor.count * size;
  const values = (() => {
    switch (accessor.componentType) {
      case 5126:
        return new Float32Array(binary, start, count);
      case 5125:
        return new Uint32Array(binary, start, count);
      case 5123:
        return new Uint16Array(binary, start, count);
      case 5121:
        return new Uint8Array(binary, start, count);
      default:
        throw new Error(`component type ${accessor.componentType} of a GLB file`);
    }
  })();
  return new BufferAttribute(values, size, accessor.normalized ?? false);
}

async function readTexture(document: Document, binary: ArrayBuffer, source: number): Promise<Texture> {
  const image = document.images![source]!;
  const { byteOffset = 0, byteLength } = document.bufferViews![image.bufferView]!;
  const blob = new Blob([new Uint8Array(binary, byteOffset, byteLength)], { type: image.mimeType });
  const texture = new Texture(await createImageBitmap(blob, { colorSpaceConversion: "none", premultiplyAlpha: "none" }));
  texture.flipY = false;
  texture.wrapS = RepeatWrapping;
  texture.wrapT = RepeatWrapping;
  texture.colorSpace = SRGBColorSpace;
  texture.anisotropy = 4;
  texture.needsUpdate = true;
  return texture;
}

/** Phong in place of the physical model: a fraction of its cost where no GPU is. */
function readMaterial(own: NonNullable<Document["materials"]>[number], textures: Texture[]): MeshPhongMaterial {
  const pbr = own.pbrMetallicRoughness ?? {};
  const [r, g, b, a] = pbr.baseColorFactor ?? [1, 1, 1, 1];
  const roughness = pbr.roughnessFactor ?? 1;
  const metallic = pbr.metallicFactor ?? 1;
  const color = new Color(r, g, b);
  const gloss = (1 - roughness) ** 2;
  const specular = new Color(0.35 * gloss + 0.02, 0.35 * gloss + 0.02, 0.35 * gloss + 0.02).lerp(color, 0.6 * metallic);
  const map = pbr.baseColorTexture ? (textures[pbr.baseColorTexture.index] ?? null) : null;
  return new MeshPhongMaterial({
    color,
    specular,
    shininess: 8 + 120 * gloss,
    map,
    side: own.doubleSided ? DoubleSide : FrontSide,
    transparent: own.alphaMode === "BLEND",
    // Glass that is nearly clear would not be seen against a plain table.
    opacity: own.alphaMode === "BLEND" ? Math.max(0.35, a) : 1,
    depthWrite: own.alphaMode !== "BLEND",
  });
}
