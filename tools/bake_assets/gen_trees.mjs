// Grow trees with ez-tree without a browser:  node gen_trees.mjs OUT  (needs `npm i @dgreenheck/ez-tree@1.1.0`)
// Writes OUT/NAME_{branches,leaves}_{p,n,u,i}.bin and OUT/trees.json. y is up, lengths are ez-tree's own.
import fs from 'fs';
globalThis.document = { createElementNS: () => ({ addEventListener() {}, removeEventListener() {}, set src(v) {}, style: {} }) };
globalThis.self = globalThis;
globalThis.window = globalThis;
const { Tree } = await import('@dgreenheck/ez-tree');

const MAX_TRIANGLES = 7800;
const SEEDS = {
  'Oak Large': [11], 'Oak Medium': [21, 22, 23], 'Oak Small': [31, 32],
  'Ash Large': [41], 'Ash Medium': [51, 52, 53], 'Ash Small': [61, 62],
  'Aspen Large': [71], 'Aspen Medium': [81, 82, 83], 'Aspen Small': [91],
  'Pine Large': [101, 102], 'Pine Medium': [111, 112], 'Pine Small': [121, 122],
  'Bush 1': [131, 132, 133], 'Bush 2': [141, 142, 143], 'Bush 3': [151, 152],
};
const out = process.argv[2];
fs.mkdirSync(out, { recursive: true });
const cap = (values, limits) => { for (const k of Object.keys(limits)) values[k] = Math.min(values[k], limits[k]); };

function grow(preset, seed) {
  const limit = preset.startsWith('Bush') ? 4500 : MAX_TRIANGLES;
  let share = 1;
  for (;;) {  // fewer, larger leaves until it is light enough
    const tree = new Tree();
    tree.loadPreset(preset);
    tree.options.seed = seed;
    cap(tree.options.branch.sections, preset.startsWith('Pine') ? { 0: 10, 1: 3 } : { 0: 9, 1: 5, 2: 3, 3: 2 });
    cap(tree.options.branch.segments, preset.startsWith('Pine') ? { 0: 7, 1: 3 } : { 0: 7, 1: 4, 2: 3, 3: 3 });
    const count = tree.options.leaves.count;
    tree.options.leaves.count = Math.max(1, Math.round(count * share));
    tree.options.leaves.size *= Math.sqrt(count / tree.options.leaves.count);
    tree.generate();
    const triangles = (tree.branchesMesh.geometry.index.count + tree.leavesMesh.geometry.index.count) / 3;
    if (triangles <= limit || tree.options.leaves.count === 1) return [tree, triangles, share];
    share *= 0.9;
  }
}

const trees = [];
for (const [preset, seeds] of Object.entries(SEEDS)) for (const seed of seeds) {
  const [tree, triangles, share] = grow(preset, seed);
  const name = `${preset.toLowerCase().replace(' ', '-')}-${seed % 10}`;
  for (const [part, mesh] of [['branches', tree.branchesMesh], ['leaves', tree.leavesMesh]]) {
    const g = mesh.geometry;
    const arrays = { p: g.getAttribute('position').array, n: g.getAttribute('normal').array, u: g.getAttribute('uv').array,
      i: Uint32Array.from(g.index.array) };
    for (const [key, a] of Object.entries(arrays))
      fs.writeFileSync(`${out}/${name}_${part}_${key}.bin`, Buffer.from(a.buffer, a.byteOffset, a.byteLength));
  }
  const { bark, leaves } = tree.options;
  trees.push({ name, preset, seed, triangles, bark: bark.type, scale: bark.textureScale, leaf: leaves.type });
  console.log(name, triangles, share.toFixed(2));
}
fs.writeFileSync(`${out}/trees.json`, JSON.stringify(trees));
