#pragma once

namespace camber::tools {

/// Starts the program anew with the environment that makes glibc ask for huge pages (its tunables
/// are read before main): a run touches tens of thousands of pages for the first time, each of
/// which the kernel finds and clears. Does nothing where such pages are not had for the asking,
/// address space is limited, the environment has tunables of its own, or the program is
/// instrumented; and in the program so started, whose environment is then as it was.
void start_with_huge_pages(char** argv);

}  // namespace camber::tools
