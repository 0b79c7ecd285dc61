#!/bin/sh
# A Debian of its own for a test: this computer's files as they are, what is written over them in memory, systemd as
# its first process, and no network but loopback.
#
#   box.sh PLACE PACKAGE…
#
# PLACE is an empty folder. It says "furnished", when the packages are there and an ordinary user `eve` who may use sudo,
# and then the number of that first process. It ends, and leaves nothing behind, when its standard input does.
set -eu
PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
if [ "$1" != --inside ] && [ "$1" != --boot ]; then
	exec unshare --mount --propagation private -- "$0" --inside "$@"
fi
step=$1 place=$2 root=$2/root
shift 2

if [ "$step" = --inside ]; then
	mount -t tmpfs -o mode=0755 box "$place"
	mkdir "$place/upper" "$place/work" "$root"
	mount -t overlay -o "lowerdir=/,upperdir=$place/upper,workdir=$place/work" box "$root"
	# what this computer would start is none of the box's business
	rm -rf "$root"/etc/systemd/system/*.wants
	mount --rbind /dev "$root/dev"
	mount -t proc proc "$root/proc"
	mount -t tmpfs -o mode=1777 tmp "$root/tmp"
	export DEBIAN_FRONTEND=noninteractive
	chroot "$root" sh -c '
		printf "#!/bin/sh\nexit 101\n" >/usr/sbin/policy-rc.d && chmod +x /usr/sbin/policy-rc.d
		apt-get update -qq && apt-get install -y -qq --no-install-recommends "$@"
		rm /usr/sbin/policy-rc.d' sh "$@" >&2
	chroot "$root" useradd --create-home --shell /bin/sh eve
	printf 'Defaults env_keep += "PIP_* SSL_CERT_FILE"\neve ALL=(ALL) NOPASSWD: ALL\n' >"$root/etc/sudoers.d/eve"
	umount "$root/tmp" "$root/proc"
	umount -l "$root/dev"
	echo furnished
	groups=$(findmnt --noheadings --output TARGET --types cgroup2 | head -n 1)/box-$$
	mkdir "$groups"
	sh -c 'echo $$ >"$1/cgroup.procs"; shift; exec "$@"' sh "$groups" \
		unshare --pid --fork --mount --propagation private --uts --ipc --net --cgroup -- "$0" --boot "$place" &
	outer=$!
	until first=$(tr -d ' ' <"/proc/$outer/task/$outer/children") && [ "$first" ]; do sleep 0.1; done
	echo "$first"
	cat >/dev/null || true
	kill -KILL "$first"
	wait || true
	find "$groups" -depth -type d -exec rmdir {} +
	exit 0
fi

ip link set lo up
# as in containers: what belongs to the whole computer can be read only
mount -t proc proc "$root/proc"
mount --bind "$root/proc/sys" "$root/proc/sys"
mount -o remount,bind,ro "$root/proc/sys"
mount -t sysfs -o ro sysfs "$root/sys"
mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
mount -t tmpfs -o mode=0755 run "$root/run"
mount -t tmpfs -o mode=1777 tmp "$root/tmp"
mount -t tmpfs -o mode=0755 dev "$root/dev"
for device in null zero full random urandom tty; do
	touch "$root/dev/$device"
	mount --bind "/dev/$device" "$root/dev/$device"
done
mkdir "$root/dev/pts" "$root/dev/shm"
mount -t devpts -o newinstance,ptmxmode=0666,mode=0620,gid=5 devpts "$root/dev/pts"
ln -s pts/ptmx "$root/dev/ptmx"
mount -t tmpfs -o mode=1777 shm "$root/dev/shm"
cd "$root"
mkdir -p .outside
pivot_root . .outside
umount -l .outside
exec env -i container=box PATH="$PATH" /lib/systemd/systemd --unit=multi-user.target --log-target=journal
