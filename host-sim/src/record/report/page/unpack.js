// Unpacks the records of a file: lines of JSON as gzip, as Base64.

/** The records in the text of the page; none in that of a live page. */
async function unpack(text) {
  const gzip = Uint8Array.from(atob(text.trim()), (character) => character.charCodeAt(0));
  if (!gzip.length) return [];
  const lines = new Blob([gzip]).stream().pipeThrough(new DecompressionStream("gzip"));
  return (await new Response(lines).text()).trim().split("\n").map((line) => JSON.parse(line));
}
