// GeoTIFF by GDAL, which brings many shared libraries.

#include "gdal_plugin.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <exception>
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

/// Sends the file, or the sentence that gives the reason.
[[noreturn]] void encode_and_end(const Socket& to, const RoadRaster& raster, const std::string& crs,
                                 const std::map<std::string, std::string>& metadata) {
  // GDAL and the C library print before they abort.
  ::dup2(::open("/dev/null", O_WRONLY), STDERR_FILENO);
  int code = 0;
  std::string answer;
  try {
    answer = encode_geotiff(raster, crs, metadata);
  } catch (const Error& error) {
    code = error.exit_code();
    answer = error.what();
  } catch (const std::exception&) {
    ::_exit(MachineError("").exit_code());
  }
  ::_exit(to.send(answer) ? code : MachineError("").exit_code());
}

/// encode_geotiff() in a process of its own: at hundreds of places GDAL and libtiff use memory that
/// they did not get, or abort.
std::string encode_apart(const RoadRaster& raster, const std::string& crs,
                         const std::map<std::string, std::string>& metadata) {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) cannot_start(errno);
  const Socket ours(ends[0]);
  Socket theirs(ends[1]);
  const pid_t process = ::fork();
  if (process < 0) cannot_start(errno);
  if (process == 0) encode_and_end(theirs, raster, crs, metadata);
  theirs.close();
  std::string answer = ours.receive();
  int status = 0;
  while (::waitpid(process, &status, 0) < 0 && errno == EINTR) {
  }
  const int code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  if (code == 0) return answer;
  if (code == NoAnswerError("").exit_code()) throw NoAnswerError(answer);
  if (code < 0 || answer.empty()) {
    throw MachineError("GDAL broke down over the GeoTIFF, most likely for want of memory");
  }
  throw MachineError(answer);
}

const GdalFunctions kFunctions{encode_apart};

}  // namespace
}  // namespace camber::tools

CAMBER_EXPORT const camber::tools::GdalFunctions* camber_gdal();
CAMBER_EXPORT const camber::tools::GdalFunctions* camber_gdal() {
  return &camber::tools::kFunctions;
}
