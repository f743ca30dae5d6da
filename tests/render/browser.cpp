#include "browser.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <sstream>

#include "support/test_data.h"

namespace camber::test {

namespace fs = std::filesystem;

std::string find_browser() {
  for (const char* name :
       {"/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"}) {
    if (fs::exists(name)) return name;
  }
  return {};
}

std::string load_page(const std::string& browser, const fs::path& folder, const std::string& name,
                      const std::string& more) {
  const std::string f = folder.string();
  const std::string command =
      "timeout 120 " + browser +
      " --headless=new --no-sandbox --disable-dev-shm-usage --no-first-run --user-data-dir=" + f +
      "/profile --hide-scrollbars --use-gl=angle --use-angle=swiftshader "
      "--enable-unsafe-swiftshader --enable-logging=stderr --virtual-time-budget=10000 "
      "--host-resolver-rules='MAP * ~NOTFOUND' " +
      more + " --dump-dom file://" + f + "/" + name + " > " + f + "/dom.html 2> " + f +
      "/log.txt < /dev/null";
  EXPECT_EQ(std::system(command.c_str()), 0);
  return read_text(folder / "dom.html");
}

std::vector<std::string> complaints(const std::string& log) {
  std::vector<std::string> out;
  std::istringstream lines(log);
  for (std::string line; std::getline(lines, line);) {
    if (line.find("CONSOLE") == std::string::npos) continue;
    if (line.find("GPU stall due to ReadPixels") == std::string::npos) out.push_back(line);
  }
  return out;
}

}  // namespace camber::test
