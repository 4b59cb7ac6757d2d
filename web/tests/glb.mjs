// Boxes and cylinders as GLB files, the stand-ins of the mock server.

/** GLB file of one coloured part with its bottom at z = 0. */
export function standIn(shape, [width, depth, height], [r, g, b]) {
  const { positions, normals, indices } = shape === "cylinder" ? cylinder(width / 2, depth / 2, height) : box(width, depth, height);
  const floats = new Float32Array([...positions, ...normals]);
  const shorts = new Uint16Array(indices.length + (indices.length % 2));
  shorts.set(indices);
  const binary = Buffer.concat([Buffer.from(floats.buffer), Buffer.from(shorts.buffer)]);
  const count = positions.length / 3;
  const document = {
    asset: { version: "2.0" },
    scene: 0,
    scenes: [{ nodes: [0] }],
    nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0, NORMAL: 1 }, indices: 2, material: 0 }] }],
    materials: [{ pbrMetallicRoughness: { baseColorFactor: [r, g, b, 1], metallicFactor: 0, roughnessFactor: 0.6 } }],
    accessors: [
      { bufferView: 0, componentType: 5126, count, type: "VEC3" },
      { bufferView: 1, componentType: 5126, count, type: "VEC3" },
      { bufferView: 2, componentType: 5123, count: indices.length, type: "SCALAR" },
    ],
    bufferViews: [
      { buffer: 0, byteOffset: 0, byteLength: count * 12 },
      { buffer: 0, byteOffset: count * 12, byteLength: count * 12 },
      { buffer: 0, byteOffset: count * 24, byteLength: indices.length * 2 },
    ],
    buffers: [{ byteLength: binary.length }],
  };
  let text = Buffer.from(JSON.stringify(document));
  text = Buffer.concat([text, Buffer.alloc((4 - (text.length % 4)) % 4, 0x20)]);
  const chunk = (kind, bytes) => {
    const head = Buffer.alloc(8);
    head.writeUInt32LE(bytes.length, 0);
    head.write(kind, 4, "latin1");
    return Buffer.concat([head, bytes]);
  };
  const chunks = Buffer.concat([chunk("JSON", text), chunk("BIN\0", binary)]);
  const head = Buffer.alloc(12);
  head.write("glTF", 0, "latin1");
  head.writeUInt32LE(2, 4);
  head.writeUInt32LE(chunks.length + 12, 8);
  return Buffer.concat([head, chunks]);
}

function box(width, depth, height) {
  const [positions, normals, indices] = [[], [], []];
  for (let axis = 0; axis < 3; axis++) {
    for (const sign of [-1, 1]) {
      const normal = [0, 0, 0];
      normal[axis] = sign;
      const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
      const first = positions.length / 3;
      for (const [a, b] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
        const at = [0, 0, 0];
        at[axis] = sign;
        at[u] = a * sign;
        at[v] = b;
        positions.push((at[0] * width) / 2, (at[1] * depth) / 2, ((at[2] + 1) * height) / 2);
        normals.push(...normal);
      }
      indices.push(first, first + 1, first + 2, first, first + 2, first + 3);
    }
  }
  return { positions, normals, indices };
}

function cylinder(radiusX, radiusY, height) {
  const [positions, normals, indices] = [[], [], []];
  const sides = 32;
  for (let side = 0; side < sides; side++) {
    const [from, to] = [side, side + 1].map((step) => (step / sides) * 2 * Math.PI);
    const first = positions.length / 3;
    for (const angle of [from, to]) {
      for (const z of [0, height]) {
        positions.push(Math.cos(angle) * radiusX, Math.sin(angle) * radiusY, z);
        normals.push(Math.cos(angle), Math.sin(angle), 0);
      }
    }
    indices.push(first, first + 2, first + 1, first + 1, first + 2, first + 3);
    for (const [z, up] of [[height, 1], [0, -1]]) {
      const middle = positions.length / 3;
      positions.push(0, 0, z);
      normals.push(0, 0, up);
      for (const angle of up > 0 ? [from, to] : [to, from]) {
        positions.push(Math.cos(angle) * radiusX, Math.sin(angle) * radiusY, z);
        normals.push(0, 0, up);
      }
      indices.push(middle, middle + 1, middle + 2);
    }
  }
  return { positions, normals, indices };
}
