# cmake -DSOURCE=DIR -DOUT=FILE -P revision.cmake: writes revision.cpp, where it changed. Run before
# every build of the benchmarks, so that results say what their program was built from.
set(revision unknown)
set(library unknown)
find_program(GIT git)
if(GIT)
  execute_process(COMMAND ${GIT} -C ${SOURCE} describe --always --dirty OUTPUT_VARIABLE described
                  RESULT_VARIABLE failed ERROR_QUIET OUTPUT_STRIP_TRAILING_WHITESPACE)
  if(failed EQUAL 0)
    set(revision ${described})
    execute_process(COMMAND ${GIT} -C ${SOURCE} rev-parse --short=12 HEAD:lib OUTPUT_VARIABLE library
                    OUTPUT_STRIP_TRAILING_WHITESPACE)
    execute_process(COMMAND ${GIT} -C ${SOURCE} status --porcelain -- lib OUTPUT_VARIABLE changed)
    if(changed)
      string(APPEND library -dirty)
    endif()
  endif()
endif()
file(
  CONFIGURE OUTPUT ${OUT}
  CONTENT
    "#include \"benchmarks/report.h\"

namespace camber::bench {
const char* revision() { return \"${revision}\"; }
const char* library_tree() { return \"${library}\"; }
}  // namespace camber::bench
"
  @ONLY)
