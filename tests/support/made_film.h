#pragma once

// Films with a track of GoPro's metadata, by the public descriptions of both: ISO/IEC 14496-12 and
// github.com/gopro/gpmf-parser.

#include <cstdint>
#include <string>
#include <vector>

namespace camber::test {

inline std::string big_endian(std::uint64_t value, int bytes) {
  std::string out;
  for (int i = bytes - 1; i >= 0; --i) out += static_cast<char>((value >> (8 * i)) & 255U);
  return out;
}

inline std::string word(std::int64_t value) {
  return big_endian(static_cast<std::uint64_t>(value), 4);
}

inline std::string box(const std::string& type, const std::string& body) {
  return word(static_cast<std::int64_t>(body.size()) + 8) + type + body;
}

/// An item of GPMF: `data` is padded to 32 bits. @param type  '\0': items within
inline std::string klv(const std::string& key, char type, std::size_t size, std::size_t repeat,
                       std::string data) {
  data.resize((data.size() + 3) / 4 * 4, '\0');
  return key + type + big_endian(size, 1) + big_endian(repeat, 2) + data;
}

inline std::string nest(const std::string& key, const std::string& items) {
  return klv(key, '\0', 4, items.size() / 4, items);
}

/// What a camera knows of one moment.
struct MadeFix {
  double latitude = 0.0, longitude = 0.0, altitude = 0.0, speed = 0.0;
};

/// A stream of the older kind of positions.
inline std::string gps5_stream(const std::vector<MadeFix>& fixes, int fix, int dilution_by_100) {
  std::string data;
  for (const MadeFix& f : fixes) {
    data += word(static_cast<std::int64_t>(f.latitude * 1e7)) +
            word(static_cast<std::int64_t>(f.longitude * 1e7)) +
            word(static_cast<std::int64_t>(f.altitude * 1e3)) +
            word(static_cast<std::int64_t>(f.speed * 1e3)) +
            word(static_cast<std::int64_t>(f.speed * 1e2));
  }
  return nest("STRM",
              klv("STNM", 'c', 1, 3, "GPS") + klv("GPSF", 'L', 4, 1, word(fix)) +
                  klv("GPSU", 'U', 16, 1, "240501120000.000") +
                  klv("GPSP", 'S', 2, 1, big_endian(dilution_by_100, 2)) +
                  klv("SCAL", 'l', 4, 5,
                      word(10000000) + word(10000000) + word(1000) + word(1000) + word(100)) +
                  klv("GPS5", 'l', 20, fixes.size(), data));
}

/// A stream of the newer kind, whose samples have their own fix and dilution.
inline std::string gps9_stream(const std::vector<MadeFix>& fixes, int fix, double dilution) {
  std::string data;
  for (const MadeFix& f : fixes) {
    data += word(static_cast<std::int64_t>(f.latitude * 1e7)) +
            word(static_cast<std::int64_t>(f.longitude * 1e7)) +
            word(static_cast<std::int64_t>(f.altitude * 1e3)) +
            word(static_cast<std::int64_t>(f.speed * 1e3)) +
            word(static_cast<std::int64_t>(f.speed * 1e2)) + word(8887) + word(43200000) +
            big_endian(static_cast<std::uint64_t>(dilution * 100.0), 2) + big_endian(fix, 2);
  }
  std::string scale;
  for (const int one : {10000000, 10000000, 1000, 1000, 100, 1, 1000, 100, 1}) scale += word(one);
  return nest("STRM", klv("SCAL", 'l', 4, 9, scale) + klv("TYPE", 'c', 1, 9, "lllllllSS") +
                          klv("GPS9", '?', 32, fixes.size(), data));
}

/// A stream of gravity. @param samples  three numbers each, of length 1
inline std::string gravity_stream(const std::vector<std::vector<double>>& samples) {
  std::string data;
  for (const auto& sample : samples) {
    for (const double value : sample) {
      data += big_endian(static_cast<std::uint16_t>(static_cast<std::int16_t>(value * 32767.0)), 2);
    }
  }
  return nest("STRM", klv("SCAL", 's', 2, 1, big_endian(32767, 2)) +
                          klv("GRAV", 's', 6, samples.size(), data));
}

inline std::string payload(const std::string& streams) {
  return nest("DEVC",
              klv("DVID", 'L', 4, 1, word(1)) + klv("DVNM", 'c', 1, 12, "HERO11 Black") + streams);
}

/// A track of a payload a second. @param offset  of the first in the file; each is a chunk
/// @param delay_ms  between the film's start and the first payload
inline std::string telemetry_track(const std::vector<std::string>& payloads, std::size_t offset,
                                   int delay_ms = 0) {
  std::string sizes, offsets;
  for (const std::string& one : payloads) {
    sizes += word(static_cast<std::int64_t>(one.size()));
    offsets += word(static_cast<std::int64_t>(offset));
    offset += one.size();
  }
  const auto count = static_cast<std::int64_t>(payloads.size());
  const std::string zero = word(0);
  const std::string table = box("stsd", zero + word(1) + box("gpmd", word(0) + word(1))) +
                            box("stts", zero + word(1) + word(count) + word(600)) +
                            box("stsc", zero + word(1) + word(1) + word(1) + word(1)) +
                            box("stsz", zero + zero + word(count) + sizes) +
                            box("stco", zero + word(count) + offsets);
  const std::string edits =
      delay_ms == 0
          ? ""
          : box("edts", box("elst", zero + word(2) + word(delay_ms) + word(-1) + word(65536) +
                                        word(1000 * count) + word(0) + word(65536)));
  return box("trak", box("tkhd", std::string(84, '\0')) + edits +
                         box("mdia", box("mdhd", zero + zero + zero + word(600) +
                                                     word(600 * count) + zero) +
                                         box("hdlr", zero + "mhlrmeta" + std::string(12, '\0')) +
                                         box("minf", box("stbl", table))));
}

/// A film of telemetry alone. @param created_s  since 1970; 0: it does not say
inline std::string film_of_telemetry(const std::vector<std::string>& payloads,
                                     std::int64_t created_s = 0, int delay_ms = 0) {
  const std::int64_t created = created_s == 0 ? 0 : created_s + 2082844800;
  const std::string header = box("mvhd", word(0) + word(created) + word(created) + word(1000) +
                                             word(0) + std::string(80, '\0'));
  const std::string start = box("ftyp", "mp41" + word(0));
  std::string data;
  for (const std::string& one : payloads) data += one;
  const auto film = [&](std::size_t offset) {
    const std::string tracks = payloads.empty() ? "" : telemetry_track(payloads, offset, delay_ms);
    return start + box("moov", header + tracks);
  };
  const std::string measured = film(0);
  return film(measured.size() + 8) + box("mdat", data);
}

/// A film with the track beside its own. @param film  whose index (moov) is its last box
inline std::string with_telemetry(const std::string& film,
                                  const std::vector<std::string>& payloads) {
  const std::size_t moov = film.rfind("moov") - 4;
  const std::string body = film.substr(moov + 8);
  const auto whole = [&](std::size_t offset) {
    return film.substr(0, moov) + box("moov", body + telemetry_track(payloads, offset));
  };
  std::string data;
  for (const std::string& one : payloads) data += one;
  const std::string measured = whole(0);
  return whole(measured.size() + 8) + box("mdat", data);
}

}  // namespace camber::test
