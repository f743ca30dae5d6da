#pragma once

#include <stdexcept>
#include <string>

namespace camber {

/// Base of the errors that a program should report and stop on. `exit_code` is the program's exit
/// status for it (see docs/conventions.md): 1 no answer, 2 bad input, 3 the machine refuses.
class Error : public std::runtime_error {
 public:
  Error(int exit_code, const std::string& message)
      : std::runtime_error(message), exit_code_(exit_code) {}
  int exit_code() const { return exit_code_; }

 private:
  int exit_code_;
};

/// The input is sound but cannot answer the question: no parallax, an empty cloud, too few points.
class NoAnswerError : public Error {
 public:
  explicit NoAnswerError(const std::string& reason) : Error(1, reason) {}
};

/// A file that cannot be read or written; the message names the path.
class IoError : public Error {
 public:
  IoError(int exit_code, const std::string& path, const std::string& reason)
      : Error(exit_code, path + ": " + reason), path_(path) {}
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

/// An input file that is missing, damaged or unsupported. The message reads
/// "PATH: POSITION: what was found, what was expected"; POSITION is a line, byte or JSON path.
class InputError : public IoError {
 public:
  InputError(const std::string& path, const std::string& reason) : IoError(2, path, reason) {}
  InputError(const std::string& path, const std::string& position, const std::string& reason)
      : IoError(2, path, position + ": " + reason) {}
};

/// An output that cannot be written: no permission, full disk, a foreign folder in the way.
class OutputError : public IoError {
 public:
  OutputError(const std::string& path, const std::string& reason) : IoError(3, path, reason) {}
};

/// Bad usage of a program: unknown option value, contradicting options.
class UsageError : public Error {
 public:
  explicit UsageError(const std::string& message) : Error(2, message) {}
};

/// The machine cannot do what was asked: no rendering back end, out of memory.
class MachineError : public Error {
 public:
  explicit MachineError(const std::string& message) : Error(3, message) {}
};

/// The run was interrupted (SIGINT).
class InterruptedError : public Error {
 public:
  InterruptedError() : Error(130, "interrupted") {}
};

}  // namespace camber
