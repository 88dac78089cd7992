// How a page that `vnav view` serves gets a large layer: numbers and arrays in one answer, which
// begins with the length of a JSON object. Its "arrays" says where each of them lies behind it.
window.servedLayer = async (address) => {
  const answer = await fetch(address);
  if (!answer.ok) throw new Error((await answer.text()).trim());
  const all = await answer.arrayBuffer();
  const start = 4 + new DataView(all).getUint32(0, true);
  const { arrays, ...layer } = JSON.parse(new TextDecoder().decode(new Uint8Array(all, 4, start - 4)));
  for (const [name, [first, end]] of Object.entries(arrays)) layer[name] = all.slice(start + first, start + end);
  return layer;
};
