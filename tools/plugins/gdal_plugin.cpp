// GeoTIFF and vector files by GDAL, which brings many shared libraries.

#include "gdal_plugin.h"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <exception>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "camber/core/errors.h"
#include "camber/export/gdal/geotiff.h"
#include "plugin.h"

namespace camber::tools {
namespace {

/// One end of a pair of sockets.
class Socket {
 public:
  explicit Socket(int file) : file_(file) {}
  ~Socket() { close(); }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;

  void close() {
    if (file_ >= 0) ::close(file_);
    file_ = -1;
  }
  bool send(std::string_view bytes) const {
    while (!bytes.empty()) {
      const ssize_t sent = ::send(file_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (sent < 0 && errno != EINTR) return false;
      if (sent > 0) bytes.remove_prefix(static_cast<std::size_t>(sent));
    }
    return true;
  }
  /// All until the other end is closed.
  std::string receive() const {
    std::string out;
    std::array<char, 65536> part{};
    while (true) {
      const ssize_t got = ::recv(file_, part.data(), part.size(), 0);
      if (got == 0 || (got < 0 && errno != EINTR)) return out;
      if (got > 0) out.append(part.data(), static_cast<std::size_t>(got));
    }
  }

 private:
  int file_;
};

[[noreturn]] void cannot_start(int reason) {
  const bool memory = reason == ENOMEM || reason == EAGAIN || reason == ENOBUFS;
  throw MachineError(std::string(memory ? "out of memory: " : "") +
                     "no process can be started for GDAL: " + std::strerror(reason));
}

/// Sends the answer, or the sentence that gives the reason why there is none.
[[noreturn]] void answer_and_end(const Socket& to, const std::function<std::string()>& task) {
  // An interruption ends it, too, and so does the end of the program that asked.
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  // GDAL and the C library print before they abort.
  ::dup2(::open("/dev/null", O_WRONLY), STDERR_FILENO);
  int code = 0;
  std::string answer;
  try {
    answer = task();
  } catch (const Error& error) {
    code = error.exit_code();
    answer = error.what();
  } catch (const std::exception&) {
    ::_exit(MachineError("").exit_code());
  }
  ::_exit(to.send(answer) ? code : MachineError("").exit_code());
}

/// A task in a process of its own: at hundreds of places GDAL and libtiff use memory that they did
/// not get, or abort.
/// @param job  what GDAL does, for messages
std::string answer_apart(const char* job, const std::function<std::string()>& task) {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) cannot_start(errno);
  const Socket ours(ends[0]);
  Socket theirs(ends[1]);
  const pid_t process = ::fork();
  if (process < 0) cannot_start(errno);
  if (process == 0) answer_and_end(theirs, task);
  theirs.close();
  std::string answer = ours.receive();
  int status = 0;
  while (::waitpid(process, &status, 0) < 0 && errno == EINTR) {
  }
  const int code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  if (code == 0) return answer;
  if (code < 0 || answer.empty()) {
    throw MachineError(std::string("GDAL broke down over ") + job +
                       ", most likely for want of memory");
  }
  throw Error(code, answer);
}

std::string encode_apart(const RoadRaster& raster, const std::string& crs,
                         const std::map<std::string, std::string>& metadata) {
  return answer_apart("the GeoTIFF", [&] { return encode_geotiff(raster, crs, metadata); });
}

/// A task that writes a GeoTIFF; what it leaves where it breaks down is removed.
void write_apart(const std::string& out, const std::function<void()>& task) {
  try {
    answer_apart("the GeoTIFF", [&] {
      task();
      return std::string();
    });
  } catch (...) {
    for (const std::string& file : files_beside_cloud_optimized(out)) ::unlink(file.c_str());
    throw;
  }
}

void write_cog_apart(const RawRaster& raster, const std::string& crs,
                     const std::map<std::string, std::string>& metadata, const std::string& out) {
  write_apart(out, [&] { write_cloud_optimized(raster, crs, metadata, out); });
}

void copy_cog_apart(const std::string& raster, const std::string& name, const std::string& out) {
  write_apart(out, [&] { copy_cloud_optimized(raster, name, out); });
}

std::string to_bytes(const VectorLines& lines) {
  nlohmann::json out = {{"crs", lines.crs}, {"lines", nlohmann::json::array()}};
  for (const VectorLine& line : lines.lines) {
    std::vector<double> numbers;
    for (const Eigen::Vector3d& place : line.points) {
      numbers.insert(numbers.end(), {place.x(), place.y(), place.z()});
    }
    out["lines"].push_back({{"name", line.name}, {"layer", line.layer}, {"points", numbers}});
  }
  const std::vector<std::uint8_t> bytes = nlohmann::json::to_cbor(out);
  return {bytes.begin(), bytes.end()};
}

VectorLines read_apart(const std::string& path) {
  const nlohmann::json found = nlohmann::json::from_cbor(
      answer_apart("the file of lines", [&] { return to_bytes(read_vector_lines(path)); }));
  VectorLines out;
  out.crs = found.at("crs").get<std::string>();
  for (const nlohmann::json& entry : found.at("lines")) {
    VectorLine line;
    line.name = entry.at("name").get<std::string>();
    line.layer = entry.at("layer").get<std::string>();
    const auto numbers = entry.at("points").get<std::vector<double>>();
    for (std::size_t i = 0; i + 2 < numbers.size(); i += 3) {
      line.points.emplace_back(numbers[i], numbers[i + 1], numbers[i + 2]);
    }
    out.lines.push_back(std::move(line));
  }
  return out;
}

RasterHeader raster_header_apart(const std::string& path) {
  const auto task = [&] {
    const RasterHeader header = read_raster_header(path);
    const std::vector<std::uint8_t> bytes =
        nlohmann::json::to_cbor({{"crs", header.crs},
                                 {"unit", header.unit},
                                 {"band", header.band},
                                 {"height_band", header.height_band},
                                 {"sigma_band", header.sigma_band},
                                 {"columns", header.columns},
                                 {"rows", header.rows},
                                 {"place", header.place}});
    return std::string(bytes.begin(), bytes.end());
  };
  const nlohmann::json found = nlohmann::json::from_cbor(answer_apart("the GeoTIFF", task));
  RasterHeader out;
  found.at("crs").get_to(out.crs);
  found.at("unit").get_to(out.unit);
  found.at("band").get_to(out.band);
  found.at("height_band").get_to(out.height_band);
  found.at("sigma_band").get_to(out.sigma_band);
  found.at("columns").get_to(out.columns);
  found.at("rows").get_to(out.rows);
  found.at("place").get_to(out.place);
  return out;
}

/// The numbers of all windows one behind the other: the reader knows how many there are.
void read_raster_windows_apart(const std::string& path, const RasterHeader& header,
                               std::vector<RasterWindow>* windows) {
  const auto append = [](const auto& values, std::string* bytes) {
    bytes->append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(values[0]));
  };
  const std::string bytes = answer_apart("the GeoTIFF", [&] {
    read_raster(path, header, windows);
    std::string out;
    for (const RasterWindow& window : *windows) {
      append(window.values, &out);
      append(window.sigmas, &out);
    }
    return out;
  });
  std::size_t at = 0;
  const auto take = [&](std::size_t count, auto* values) {
    values->resize(count);
    const std::size_t size = count * sizeof((*values)[0]);
    if (bytes.size() - at < size) throw MachineError("GDAL broke down over the GeoTIFF");
    std::memcpy(values->data(), bytes.data() + at, size);
    at += size;
  };
  for (RasterWindow& window : *windows) {
    const auto cells =
        static_cast<std::size_t>(window.columns) * static_cast<std::size_t>(window.rows);
    take(cells, &window.values);
    if (header.sigma_band != 0) take(cells, &window.sigmas);
  }
}

const GdalFunctions kFunctions{encode_apart,   read_apart,          write_cog_apart,
                               copy_cog_apart, raster_header_apart, read_raster_windows_apart};

}  // namespace
}  // namespace camber::tools

CAMBER_EXPORT const camber::tools::GdalFunctions* camber_gdal();
CAMBER_EXPORT const camber::tools::GdalFunctions* camber_gdal() {
  return &camber::tools::kFunctions;
}
