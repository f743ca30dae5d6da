#pragma once

#include <cstddef>
#include <optional>
#include <string>

namespace camber {

/// The bytes that this process may still map under its limits of address space and data (ulimit -v
/// and -d); nothing: there is no limit.
std::optional<std::size_t> free_address_space() noexcept;

/// Before work that asks other libraries for memory, which end the process where they get none.
/// @param what needs it: "drawing a picture of 1600 x 900 pixels".
/// @throws MachineError that names memory if the limits leave fewer bytes than that.
void require_address_space(std::size_t bytes, const std::string& what);

/// For a program that works on one set of images after another: blocks of memory that are freed are
/// kept for the next allocation in place of going back to the system, which would have to clear
/// them again, a tenth of the time of a reconstruction. Changes the whole process; without effect
/// where the C library is not glibc.
void keep_freed_memory();

}  // namespace camber
