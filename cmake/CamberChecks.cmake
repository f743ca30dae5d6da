# Targets for developers, not part of the build: `format` rewrites all sources, `format_check` fails
# where one differs, `tidy` runs clang-tidy over everything that this configuration compiles, `docs`
# writes the reference, `pages` what is made of --help. The format is that of clang-format 14; other versions lay out some code
# differently.
find_program(CAMBER_CLANG_FORMAT NAMES clang-format-14)
find_program(CAMBER_RUN_CLANG_TIDY NAMES run-clang-tidy-14 run-clang-tidy)
set(camber_all_sources "find lib tools viewers tests samples -name '*.h' -o -name '*.cpp' | sort")

if(CAMBER_CLANG_FORMAT)
  add_custom_target(
    format
    COMMAND sh -c "${camber_all_sources} | xargs '${CAMBER_CLANG_FORMAT}' -i"
    WORKING_DIRECTORY ${PROJECT_SOURCE_DIR}
    VERBATIM)
  add_custom_target(
    format_check
    COMMAND sh -c "${camber_all_sources} | xargs '${CAMBER_CLANG_FORMAT}' --dry-run -Werror"
    WORKING_DIRECTORY ${PROJECT_SOURCE_DIR}
    VERBATIM)
endif()
if(CAMBER_RUN_CLANG_TIDY)
  add_custom_target(
    tidy
    COMMAND ${CAMBER_RUN_CLANG_TIDY} -quiet -p ${PROJECT_BINARY_DIR}
            "${PROJECT_SOURCE_DIR}/(lib|tools|viewers|tests|samples)/.*[.]cpp$"
    WORKING_DIRECTORY ${PROJECT_SOURCE_DIR}
    VERBATIM USES_TERMINAL)
endif()

# The reference of the public headers, in docs/html of the build folder.
find_program(CAMBER_DOXYGEN doxygen)
if(CAMBER_DOXYGEN)
  configure_file(${PROJECT_SOURCE_DIR}/cmake/Doxyfile.in ${PROJECT_BINARY_DIR}/Doxyfile @ONLY)
  add_custom_target(
    docs
    COMMAND ${CMAKE_COMMAND} -E make_directory ${PROJECT_BINARY_DIR}/docs
    COMMAND ${CAMBER_DOXYGEN} ${PROJECT_BINARY_DIR}/Doxyfile
    WORKING_DIRECTORY ${PROJECT_SOURCE_DIR}
    VERBATIM)
endif()

# docs/commands.md and, in man1 of the build folder, the man pages.
find_package(Python3 QUIET COMPONENTS Interpreter)
if(TARGET camber AND Python3_Interpreter_FOUND)
  add_custom_target(
    pages
    COMMAND ${Python3_EXECUTABLE} -B docs/make_pages.py $<TARGET_FILE:camber> --markdown
            docs/commands.md
    COMMAND ${Python3_EXECUTABLE} -B docs/make_pages.py $<TARGET_FILE:camber> --man
            ${PROJECT_BINARY_DIR}/man1
    DEPENDS camber
    WORKING_DIRECTORY ${PROJECT_SOURCE_DIR}
    VERBATIM)
endif()
