#!/bin/sh
# Install the Debian packages of packages.txt (and of the lists named as arguments) that are missing, by name. Says what
# it will install; does nothing and touches no network when all are there.
set -eu
missing=
for package in $(sed 's/#.*//' packages.txt "$@"); do
	dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing="$missing $package"
done
[ -n "$missing" ] || exit 0
echo "installing:$missing"
sudo=
[ "$(id -u)" = 0 ] || sudo=sudo
$sudo apt-get update -qq
DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y -qq --no-install-recommends $missing
