# Packages by CPack: the program, the shared library, what a compiler needs, and one archive of all.
# Used by scripts/make_packages.sh with a build of shared libraries.
set(doc "${CMAKE_INSTALL_DATADIR}/doc")
set(packaging "${PROJECT_BINARY_DIR}/packaging")

file(READ "${PROJECT_SOURCE_DIR}/THIRD_PARTY.md" notices)
# Debian wants copyright and changelog of every package in its own folder.
configure_file("${PROJECT_SOURCE_DIR}/packaging/copyright.in" "${packaging}/copyright" @ONLY)
configure_file("${PROJECT_SOURCE_DIR}/packaging/changelog.in" "${packaging}/changelog" @ONLY)
execute_process(COMMAND gzip -9nc "${packaging}/changelog" OUTPUT_FILE "${packaging}/changelog.gz" COMMAND_ERROR_IS_FATAL ANY)
foreach(pair program:palpate library:libpalpate0.1 development:libpalpate-dev)
  string(REPLACE ":" ";" pair ${pair})
  list(GET pair 0 component)
  list(GET pair 1 package)
  install(FILES "${packaging}/copyright" "${packaging}/changelog.gz" DESTINATION ${doc}/${package} COMPONENT ${component})
endforeach()
install(FILES "${PROJECT_SOURCE_DIR}/THIRD_PARTY.md" DESTINATION ${doc}/palpate COMPONENT program)
install(CODE "execute_process(COMMAND \"${PROJECT_SOURCE_DIR}/tools/third_party.py\" spdx \"${PROJECT_BINARY_DIR}\" \"${packaging}/palpate.spdx.json\" COMMAND_ERROR_IS_FATAL ANY)"
        COMPONENT program)
install(FILES "${packaging}/palpate.spdx.json" DESTINATION ${doc}/palpate COMPONENT program)
install(DIRECTORY "${PROJECT_SOURCE_DIR}/examples" DESTINATION ${doc}/libpalpate-dev COMPONENT development)

set(CPACK_PACKAGE_NAME palpate)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_CONTACT "Palpate maintainers <maintainers@palpate.invalid>")
set(CPACK_PACKAGE_DIRECTORY "${PROJECT_BINARY_DIR}/packages")
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL program library development)
set(CPACK_DEBIAN_ENABLE_COMPONENT_DEPENDS OFF)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(about "You move a rigid tool through the live point cloud of a depth camera, and a
thousand times a second Palpate measures how much of the tool's volume lies
inside the scene and in which direction it is pushed out.")
set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME palpate)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PROGRAM_DESCRIPTION "${about}

This package has the program, with its viewer.")
set(CPACK_DEBIAN_LIBRARY_PACKAGE_NAME libpalpate0.1)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_CONTROL_EXTRA "${PROJECT_SOURCE_DIR}/packaging/triggers")
set(CPACK_DEBIAN_LIBRARY_DESCRIPTION "${about}

This package has the shared libraries.")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libpalpate-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS "libpalpate0.1 (= ${PROJECT_VERSION})")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_DEVELOPMENT_DESCRIPTION "${about}

This package has headers, files for CMake and pkg-config, and examples.")
set(CPACK_ARCHIVE_COMPONENT_INSTALL OFF)
include(CPack)
