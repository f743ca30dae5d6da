#pragma once

#include <map>
#include <string>
#include <vector>

#include "cli/run_program.h"
#include "support/test_data.h"

namespace camber::test {

/// A command on small inputs; the one table that the tests of this folder go through.
struct VerbCase {
  std::vector<std::string> arguments;  ///< files relative to the folder, results below out/
  std::vector<std::string> inputs;     ///< files and folders that it reads
  bool slow = false;                   ///< more than some 0.2 s of one core
  bool draws = false;  ///< loads a driver of OpenGL, which survives no lack of memory
  int exit_code = 0;   ///< of a sound run
  /// It takes the place of an earlier result as it goes, and what a part of a run measured stays.
  bool keeps_its_part = false;
  /// A process of its own (GDAL's) writes files and reads them back: its end is a refusal.
  bool writes_apart = false;
  /// Whether it writes pictures or plots, in which VTK draws the text: where it has no memory it
  /// leaves letters out, or writes beyond its own.
  bool writes_pictures() const;
  std::string name() const;  ///< "import kitti", "export opencrg", "convert"
};

/// A folder of small inputs of every kind, made once a process and removed at its end. Commands
/// run in it and write below its folder out/.
class WorkFolder {
 public:
  static WorkFolder& instance();

  const std::filesystem::path& path() const { return folder_.path(); }
  std::filesystem::path out() const { return path() / "out"; }
  const std::vector<VerbCase>& cases() const { return cases_; }

  /// Runs a command in the folder with one thread, in an environment without a display.
  ProgramResult run(const std::vector<std::string>& arguments,
                    Surroundings surroundings = {}) const;

  /// Removes what is in out/.
  void clear_out() const;

 private:
  WorkFolder();
  void make_clouds() const;
  void make_scenes() const;
  void make_imports() const;
  void must_run(const std::vector<std::string>& arguments) const;
  void add_cases();

  TemporaryFolder folder_;
  std::vector<VerbCase> cases_;
};

/// What is below a folder as snapshot() has it, but without what differs from run to run: the
/// timings in JSON files and the reports that show them.
std::map<std::string, std::string> without_timings(std::map<std::string, std::string> files);

/// Whether two folders are the same so.
bool same_but_timings(const std::map<std::string, std::string>& a,
                      const std::map<std::string, std::string>& b);

/// Whether tests/run.sh --long asked for the tests that take minutes.
bool is_long_run();

}  // namespace camber::test
