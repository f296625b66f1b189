// Unpacks the records of a file; pack.rs has the format: gzip as Base64, in it a line of JSON and columns of whole numbers.

/** The records in the text of the page; none in that of a live page. */
async function unpack(text) {
  const packed = text.trim();
  if (!packed) return [];
  const binary = atob(packed);
  const gzip = new Uint8Array(binary.length);
  for (let index = 0; index < gzip.length; index += 1) gzip[index] = binary.charCodeAt(index);
  const stream = new Blob([gzip]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const end = bytes.indexOf(10);
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(0, end)));
  let at = end + 1;
  const records = [...head.first];
  for (const { kind, rows, shape, columns } of head.tables) {
    const values = columns.map((column) => {
      const list = new Float64Array(column.count);
      at = readColumn(bytes, at, list);
      column.lags.toReversed().forEach((lag) => sum(list, lag));
      return list;
    });
    const read = reader(shape, values);
    for (let row = 0; row < rows; row += 1) {
      const record = read();
      record.kind = kind;
      records.push(record);
    }
  }
  return records.concat(head.last);
}

/** Fills a list with zigzag LEB128 numbers; returns where they end. */
function readColumn(bytes, from, list) {
  let at = from;
  for (let index = 0; index < list.length; index += 1) {
    let byte = bytes[at++];
    let value = byte & 0x7f;
    // No bits beyond the 32nd with the operators for bits.
    for (let scale = 128; byte & 0x80; scale *= 128) {
      byte = bytes[at++];
      value += (byte & 0x7f) * scale;
    }
    list[index] = value % 2 ? -(value + 1) / 2 : value / 2;
  }
  return at;
}

/** Undoes the differences to the value `lag` places before. */
function sum(list, lag) {
  for (let index = lag; index < list.length; index += 1) list[index] += list[index - lag];
}

/** A function that returns the next value of a shape; takes its columns from the front of the list. */
function reader(shape, columns) {
  const [[name, what]] = Object.entries(shape);
  if (name === "nothing") return () => undefined;
  if (name === "list") {
    const lengths = cursor(columns.shift());
    if (what.number !== undefined) return numberLists(lengths, columns.shift(), 10 ** what.number);
    const each = reader(what, columns);
    return () => {
      const length = lengths();
      const list = new Array(length);
      for (let index = 0; index < length; index += 1) list[index] = each();
      return list;
    };
  }
  if (name === "tuple") {
    const parts = what.map((part) => reader(part, columns));
    return () => parts.map((part) => part());
  }
  if (name === "fields") {
    const fields = what.map(([field, mayMiss, inner]) => {
      const present = mayMiss ? cursor(columns.shift()) : () => 1;
      return [field, present, reader(inner, columns)];
    });
    return () => {
      const record = {};
      for (const [field, present, next] of fields) if (present()) record[field] = next();
      return record;
    };
  }
  const next = cursor(columns.shift());
  if (name === "flag") return () => next() === 1;
  if (name === "text") return () => what[next()];
  const scale = 10 ** what;
  return () => next() / scale;
}

/** Lists of numbers, which are most of what there is. */
function numberLists(lengths, column, scale) {
  let at = 0;
  const values = column.map((value) => value / scale);
  return () => {
    const length = lengths();
    at += length;
    return Array.from(values.subarray(at - length, at));
  };
}

function cursor(column) {
  let at = 0;
  return () => column[at++];
}
