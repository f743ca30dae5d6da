# cmake -DBUILD=... -DSOURCE=... -DWORK=... -DEXAMPLE=... -DSCENE=... [-DLAUNCHER=...]
#       -P package_test.cmake
# Installs a build into an empty prefix; then configures, builds and runs separate projects there.
set(prefix ${WORK}/prefix)
set(heavy "VTK|vtk|[Oo]pen[Cc][Vv]|[Cc]eres")
file(REMOVE_RECURSE ${WORK})
function(step what)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE status OUTPUT_VARIABLE out ERROR_VARIABLE out)
  if(NOT status EQUAL 0)
    message(FATAL_ERROR "${what} ended with ${status}:\n${out}")
  endif()
  set(output "${out}" PARENT_SCOPE)
endfunction()
# All libraries at once take ld 3 s, gold 0.6.
find_program(gold ld.gold)
set(linker "")
if(gold)
  set(linker -DCMAKE_EXE_LINKER_FLAGS=-fuse-ld=gold)
endif()
# configure(PROJECT OPTIONS...): the command that configures a project of this folder. Nothing is
# optimised: what is tested is found, compiled and linked.
macro(configure project)
  set(configure ${CMAKE_COMMAND} -S ${CMAKE_CURRENT_LIST_DIR}/${project} -B ${WORK}/${project} -G Ninja
                -DCMAKE_BUILD_TYPE= -DCMAKE_PREFIX_PATH=${prefix} ${linker}
                -DCMAKE_CXX_COMPILER_LAUNCHER=${LAUNCHER} --no-warn-unused-cli ${ARGN})
endmacro()

step("cmake --install" ${CMAKE_COMMAND} --install ${BUILD} --prefix ${prefix})
file(GLOB_RECURSE private_headers ${prefix}/include/camber/*/detail/*)
if(private_headers)
  message(FATAL_ERROR "private headers are installed: ${private_headers}")
endif()

# Everything, with a library example and a program that uses one module of it.
set(plane -DPROGRAM=${SOURCE}/samples/02_fit_plane.cpp)
configure(consumer -DEXAMPLE=${EXAMPLE} ${plane})
step("configuring the project that uses the package" ${configure})
# Found in the prefix, and nowhere else: nothing of the source tree or of its build.
file(STRINGS ${WORK}/consumer/CMakeCache.txt found REGEX "^camber_DIR:")
string(FIND "${found}" "=${prefix}/" place)
if(place EQUAL -1)
  message(FATAL_ERROR "the package was not found in ${prefix} but: ${found}")
endif()
file(GLOB_RECURSE package_files ${prefix}/*.cmake)
foreach(file IN LISTS package_files)
  file(STRINGS ${file} leaks REGEX "${BUILD}")
  if(leaks)
    message(FATAL_ERROR "${file} mentions the build folder: ${leaks}")
  endif()
endforeach()
step("building the project that uses the package" ${CMAKE_COMMAND} --build ${WORK}/consumer)
step("the program that includes every header" ${WORK}/consumer/all_headers)
if(EXAMPLE)
  step("the library example" ${WORK}/consumer/example ${SCENE})
  if(NOT output MATCHES "${EXPECTED}")
    message(FATAL_ERROR "the library example printed nothing like ${EXPECTED}:\n${output}")
  endif()
endif()

# Asking for one module finds nothing of the others.
configure(consumer_plane ${plane} -DCOMPONENTS=plane)
step("configuring the project that asks for a component" ${configure})
file(STRINGS ${WORK}/consumer_plane/CMakeCache.txt found REGEX "^(${heavy})[A-Za-z]*_DIR:")
if(found)
  message(FATAL_ERROR "the component plane finds ${found}")
endif()
step("building the project that asks for a component" ${CMAKE_COMMAND} --build
     ${WORK}/consumer_plane)

# Neither asking for it nor naming no component brings the others' libraries into the program.
foreach(project IN ITEMS consumer consumer_plane)
  set(program ${WORK}/${project}/fit_plane)
  step("the program of ${project}" ${program} ${SCENE}/truth/road.ply)
  step("ldd" ldd ${program})
  if(output MATCHES "${heavy}")
    message(FATAL_ERROR "a program that links camber::plane loads other libraries:\n${output}")
  endif()
endforeach()

# A machine without the heavy libraries; the same folder again, which found none of them.
configure(consumer_plane -DCOMPONENTS=plain)
execute_process(COMMAND ${configure} RESULT_VARIABLE status OUTPUT_VARIABLE out ERROR_VARIABLE out)
string(REGEX REPLACE "[ \n]+" " " out "${out}")
if(status EQUAL 0 OR NOT out MATCHES "There is no component plain; the components are core geometry")
  message(FATAL_ERROR "a component that does not exist ended with ${status}:\n${out}")
endif()
set(lacking -DCMAKE_DISABLE_FIND_PACKAGE_VTK=ON -DCMAKE_DISABLE_FIND_PACKAGE_OpenCV=ON
            -DCMAKE_DISABLE_FIND_PACKAGE_Ceres=ON)
configure(consumer_plane ${lacking} "-DCOMPONENTS=plane,road")
execute_process(COMMAND ${configure} RESULT_VARIABLE status OUTPUT_VARIABLE out ERROR_VARIABLE out)
string(REGEX REPLACE "[ \n]+" " " out "${out}")
if(status EQUAL 0 OR NOT out MATCHES "camber::road needs Ceres, which was not found")
  message(FATAL_ERROR "a component without its packages ended with ${status}:\n${out}")
endif()
configure(consumer_plane -DCOMPONENTS= "-DABSENT=image,road,render,pipeline")
step("configuring without the packages of other modules" ${configure})

# The program, moved: it finds its plugins beside itself, and says so where one is missing.
file(RENAME ${prefix} ${WORK}/moved)
step("the installed program" ${WORK}/moved/bin/camber --version)
if(NOT output MATCHES "^camber [0-9]+[.][0-9]+[.][0-9]+\n$")
  message(FATAL_ERROR "camber --version printed: ${output}")
endif()
step("a command of the installed program" ${WORK}/moved/bin/camber plane ${SCENE}/truth/road.ply --threshold 0.05)
file(GLOB_RECURSE plugin ${WORK}/moved/*/libcamber_clouds.so)
file(REMOVE ${plugin})
execute_process(COMMAND ${WORK}/moved/bin/camber plane ${SCENE}/truth/road.ply --threshold 0.05
                RESULT_VARIABLE status OUTPUT_VARIABLE out ERROR_VARIABLE error)
if(NOT status EQUAL 3 OR NOT out STREQUAL ""
   OR NOT error MATCHES "^camber: [^\n]*libcamber_clouds.so: no such file[^\n]*\n$")
  message(FATAL_ERROR "without its plugin the program ended with ${status}:\n${out}${error}")
endif()
file(REMOVE_RECURSE ${WORK})
