/** The scene that the document carries: the JSON header, and typed arrays over the inflated data. */
async function readScene() {
  const header = JSON.parse(document.getElementById("header").textContent);
  const packed = Uint8Array.from(atob(document.getElementById("data").textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return { ...header, ...unpacked(header, await new Response(stream).arrayBuffer()) };
}

/** Arrays in the order in which html.py writes them. */
function unpacked(header, buffer) {
  const vertices = header.objects.reduce((sum, o) => sum + o.vertices, 0);
  const corners = 3 * header.objects.reduce((sum, o) => sum + o.triangles, 0);
  let offset = 0;
  const take = (Type, count) => {
    const array = new Type(buffer, offset, count);
    offset += array.byteLength;
    return array;
  };
  const faces = take(Int32Array, corners);
  const steps = take(Uint16Array, 3 * vertices);
  const freeSteps = take(Uint16Array, 3 * header.free.points);
  const normals = take(Int8Array, 3 * vertices);
  const colors = take(Uint8Array, 3 * vertices);
  const positions = new Float32Array(3 * vertices);
  const indices = new Uint32Array(corners);
  let vertex = 0;
  let corner = 0;
  for (const object of header.objects) {
    expand(object, steps, positions, vertex, object.vertices);
    object.firstCorner = corner;
    for (let index = 0, k = 0; k < 3 * object.triangles; k++) {
      index += faces[corner];
      indices[corner++] = index + vertex;
    }
    vertex += object.vertices;
  }
  const free = new Float32Array(3 * header.free.points);
  expand(header.free, freeSteps, free, 0, header.free.points);
  return { positions, normals, pointColors: colors, indices, freePositions: free };
}

function expand(box, steps, out, first, count) {
  for (let k = 3 * first; k < 3 * (first + count); k++) out[k] = box.low[k % 3] + box.step[k % 3] * steps[k];
}
