// node laz_perf.js FILE.laz OUT: the records of a LAZ file as the npm package laz-perf decodes them.
const fs = require('fs');
const { createLazPerf } = require('laz-perf');

createLazPerf().then((library) => {
  const bytes = fs.readFileSync(process.argv[2]);
  const place = library._malloc(bytes.length);
  library.HEAPU8.set(bytes, place);
  const file = new library.LASZip();
  file.open(place, bytes.length);
  const count = file.getCount(), size = file.getPointLength();
  const record = library._malloc(size);
  const out = Buffer.alloc(count * size);
  for (let i = 0; i < count; ++i) {
    file.getPoint(record);
    out.set(library.HEAPU8.subarray(record, record + size), i * size);
  }
  fs.writeFileSync(process.argv[3], out);
});
