#pragma once

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <string>

namespace camber::test {

/// An X server in memory for as long as it lives; number() is empty where there is no Xvfb.
class VirtualDisplay {
 public:
  explicit VirtualDisplay(const char* screen = "640x480x24") {
    int ends[2];
    if (::pipe(ends) != 0) return;
    process_ = ::fork();
    if (process_ == 0) {
      ::dup2(ends[1], 3);
      const int null = ::open("/dev/null", O_WRONLY);
      ::dup2(null, 2);
      ::execlp("Xvfb", "Xvfb", "-noreset", "-displayfd", "3", "-screen", "0", screen, "-nolisten",
               "tcp", nullptr);
      ::_exit(127);
    }
    ::close(ends[1]);
    char text[32] = {};
    for (std::size_t used = 0; used + 1 < sizeof(text); ++used) {
      if (::read(ends[0], text + used, 1) != 1 || text[used] == '\n') {
        text[used] = 0;
        break;
      }
    }
    ::close(ends[0]);
    number_ = text;
  }
  ~VirtualDisplay() {
    if (process_ <= 0) return;
    ::kill(process_, SIGTERM);
    ::waitpid(process_, nullptr, 0);
  }
  VirtualDisplay(const VirtualDisplay&) = delete;
  VirtualDisplay& operator=(const VirtualDisplay&) = delete;
  const std::string& number() const { return number_; }

 private:
  pid_t process_ = -1;
  std::string number_;
};

}  // namespace camber::test
