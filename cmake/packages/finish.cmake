# Run by CPack on each package's files before they are packed: what Debian wants beside them.
set(names_program camber)
set(names_development libcamber-dev)
set(names_viewer camber-viewer)
set(names_python python3-camber)

set(seconds $ENV{SOURCE_DATE_EPOCH}) # options.cmake
string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
file(READ ${CPACK_CAMBER_SOURCE_DIR}/LICENSE license)
string(REGEX REPLACE "^[^\n]*\n+[^\n]*\n+" "" license "${license}") # title and holder
string(REGEX REPLACE "\n\n" "\n.\n" license "${license}")
string(REGEX REPLACE "\n$" "" license "${license}")
string(REPLACE "\n" "\n " license " ${license}")

foreach(component IN LISTS CPACK_COMPONENTS_ALL)
  set(name ${names_${component}})
  set(root ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/${component}/usr)
  if(NOT IS_DIRECTORY ${root})
    continue()
  endif()
  set(documents ${root}/share/doc/${name})
  file(WRITE ${documents}/copyright
       "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: camber

Files: *
Copyright: 2026 the Camber authors
License: BSD-3-clause

License: BSD-3-clause
${license}
")
  file(WRITE ${documents}/changelog
       "camber (${CPACK_CAMBER_VERSION}) unstable; urgency=medium

  * See CHANGELOG.md of the source.

 -- ${CPACK_PACKAGE_CONTACT}  ${date}
")
  file(GLOB pages ${root}/share/man/man1/*.1)
  execute_process(COMMAND gzip -9n ${documents}/changelog ${pages} COMMAND_ERROR_IS_FATAL ANY)
  # Files of one time, so that two builds give equal packages.
  execute_process(COMMAND find ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/${component} -exec touch
                          --no-dereference --date=@${seconds} {} + COMMAND_ERROR_IS_FATAL ANY)
endforeach()
