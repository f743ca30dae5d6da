// node laz_perf.js FILE.laz [OUT]: the records of a LAZ file as the npm package laz-perf decodes
// them; without OUT it prints the seconds of CPU that this takes.
const fs = require('fs');
const { createLazPerf } = require('laz-perf');

createLazPerf().then((library) => {
  const bytes = fs.readFileSync(process.argv[2]);
  const place = library._malloc(bytes.length);
  library.HEAPU8.set(bytes, place);
  const before = process.cpuUsage();
  const file = new library.LASZip();
  file.open(place, bytes.length);
  const count = file.getCount(), size = file.getPointLength();
  const record = library._malloc(size);
  if (process.argv.length < 4) {
    for (let i = 0; i < count; ++i) file.getPoint(record);
    const used = process.cpuUsage(before);
    console.log((used.user + used.system) / 1e6);
    return;
  }
  const out = Buffer.alloc(count * size);
  for (let i = 0; i < count; ++i) {
    file.getPoint(record);
    out.set(library.HEAPU8.subarray(record, record + size), i * size);
  }
  fs.writeFileSync(process.argv[3], out);
});
