#!/bin/sh
# In the bare system of `cargo xtask package --check`: install, run two stations whose CPs talk to each other, purge.
set -eu
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root

say() { echo "inside: $*"; }
fail() { say "FAILED: $*"; exit 1; }
booted() { [ -d /run/systemd/system ]; }

# Everything that is there, but what the machine itself keeps writing.
files() {
    find / -xdev \( -path /proc -o -path /sys -o -path /dev -o -path /tmp -o -path /check -o -path /run/systemd \
        -o -path /var/log -o -path /var/cache -o -path /var/lib/systemd -o -path /var/lib/dpkg -o -path /run/udev \) \
        -prune -o -print | sort
}

# Where `systemctl enable` writes: it may stay empty.
mkdir -p /etc/systemd/system/multi-user.target.wants
files | grep -v '/multi-user.target.wants$' > /tmp/before
dpkg -i /check/ob1.deb
ob1 --version

# Two stations of the examples, with the real time that a new station asks for.
ob1 new station /tmp/new
sed -n '/^\[cpu.realtime\]/,/^$/p' /tmp/new/station.toml > /tmp/realtime
for side in a b; do
    mkdir -p /etc/ob1/$side
    sed 's,\.\./two-stations,/usr/share/doc/ob1/examples/two-stations,' \
        /usr/share/doc/ob1/examples/simulated-line/station-$side.toml > /etc/ob1/$side/station.toml
    { echo; cat /tmp/realtime; printf '\n[retentive]\nmemory = ["100..103"]\n'; } >> /etc/ob1/$side/station.toml
    if [ $side = a ]; then
        printf '\n[[link]]\ntype = "web"\nname = "page"\nlisten = "127.0.0.1:8080"\n' >> /etc/ob1/a/station.toml
        printf '\n[[link]]\ntype = "opcua"\nname = "scada"\nlisten = "127.0.0.1:4840"\n' >> /etc/ob1/a/station.toml
    fi
    ob1 check /etc/ob1/$side/station.toml
done

# Limits can be raised by a root that has CAP_SYS_RESOURCE; in some containers it has not.
limits=
if (ulimit -r 99 && ulimit -l unlimited) 2>/dev/null; then limits=yes; fi

start() {
    if booted; then
        systemctl start ob1@$1
    else
        # The user and the limits of the unit.
        mkdir -p /var/lib/ob1/$1
        chown ob1:ob1 /var/lib/ob1/$1
        (cd /etc/ob1/$1 && { [ -z "$limits" ] || { ulimit -r 99; ulimit -l unlimited; }; } &&
            STATE_DIRECTORY=/var/lib/ob1/$1 setpriv --reuid=ob1 --regid=ob1 --init-groups --bounding-set=-all --no-new-privs \
            ob1 run station.toml) > /tmp/run-$1.log 2>&1 &
        eval "run_$1=$!"
    fi
}
stop() {
    if booted; then
        systemctl stop ob1@$1
        systemctl is-failed --quiet ob1@$1 && fail "ob1@$1 has failed"
        return 0
    fi
    kill -TERM "$(cat /run/ob1/simulated-line-$1/pid)"
    eval "wait \$run_$1"
}

# Waits until a command succeeds.
until_true() {
    tries=600
    until "$@" > /tmp/answer 2>&1; do
        tries=$((tries - 1))
        if [ $tries = 0 ]; then
            cat /tmp/answer
            cat /tmp/run-*.log 2>/dev/null || true
            if booted; then journalctl --no-pager -u 'ob1@*' | tail -40; fi
            fail "$*"
        fi
        sleep 0.2
    done
}
in_run() { ob1 ctl "$1" status --json | grep -q '"state": *"RUN"'; }
good() { [ "$(ob1 get simulated-line-a DB20.GOOD --json | tr -d ' \n' | sed 's/.*"value"://; s/[^0-9].*//')" -ge 20 ]; }

page() {
    bash -c 'exec 3<>/dev/tcp/127.0.0.1/8080
        printf "GET / HTTP/1.1\r\nHost: 127.0.0.1:8080\r\nConnection: close\r\n\r\n" >&3; cat <&3' > /tmp/page
    grep -q '^HTTP/1.1 200' /tmp/page && grep -qi '<html' /tmp/page
}

# Also after the next start of the machine, until the package is purged. Not every bare system has systemctl.
enabled=/etc/systemd/system/multi-user.target.wants/ob1@a.service
if command -v systemctl > /dev/null; then systemctl enable ob1@a; else ln -s /usr/lib/systemd/system/ob1@.service $enabled; fi
[ -h $enabled ] || fail "ob1@a is not enabled"

start a
start b
until_true in_run simulated-line-a
until_true in_run simulated-line-b
until_true good
until_true page
say "the station shows its page: $(wc -c < /tmp/page) bytes"
# What a link keeps lies where the service may write.
until_true test -f /var/lib/ob1/a/simulated-line-a.gate/scada/pki/private/private.pem
say "OPC UA has made its key"
say "20 telegrams went over the line of two CPs and came back right"
ob1 get simulated-line-a DB20.GOOD DB20.WRONG DB20.DOUBLED
ob1 diag simulated-line-a

# The scan thread is under FIFO (policy 1) with the priority asked for; its process has its memory locked.
pid=$(cat /run/ob1/simulated-line-a/pid)
[ "$(stat -c %U /proc/$pid)" = ob1 ] || fail "not run by the user ob1"
if [ -n "$limits" ]; then
    fifo=$(cat /proc/$pid/task/*/stat | sed 's/^.*) //' | awk '$39 == 1 && $38 == 50' | wc -l)
    [ "$fifo" = 1 ] || fail "$fifo threads under FIFO"
    locked=$(awk '/^VmLck/ { print $2 }' /proc/$pid/status)
    [ "$locked" -gt 0 ] || fail "no locked memory"
    say "FIFO with priority 50, $locked kB locked"
else
    say "NOT CHECKED: FIFO and locked memory; this machine lets nobody raise limits"
fi
grep -q '^CapEff:[[:space:]]*0000000000000000$' /proc/$pid/status || fail "it has capabilities"
grep -q '^NoNewPrivs:[[:space:]]*1$' /proc/$pid/status || fail "it may get new privileges"
say "no capability, no new privileges, user ob1"
# A driver of the station raised its own fences on top of those of the unit.
drivers=0
for process in /proc/[0-9]*; do
    [ "$(cat $process/comm 2>/dev/null)" = ob1-cp ] || continue
    drivers=$((drivers + 1))
    grep -q '^Seccomp:[[:space:]]*2$' $process/status || fail "$process has no seccomp filter"
done
if booted; then
    grep -q '^Seccomp:[[:space:]]*2$' /proc/$pid/status || fail "the unit gives the runtime no seccomp filter"
    journalctl --no-pager -u 'ob1@*' > /tmp/journal
    if grep 'not confined' /tmp/journal | grep -v 'this kernel does not have it'; then fail "the unit keeps a driver from raising its fences"; fi
fi
[ $drivers -ge 3 ] || fail "$drivers processes ob1-cp: two CPs and their line are three"

# Killed without a word: the guardian cleans up, also under the unit, and the station starts again.
gone() { [ ! -e "$1" ]; }
kill -KILL "$(cat /run/ob1/simulated-line-b/pid)"
until_true gone /run/ob1/simulated-line-b
if booted; then systemctl reset-failed ob1@b; fi
start b
until_true in_run simulated-line-b
say "killed, cleaned up, started again"

stop a
stop b
[ ! -e /run/ob1/simulated-line-a ] || fail "the runtime directory is still there"
ls -A /var/lib/ob1/a | grep -q retentive || fail "no retentive file in /var/lib/ob1/a"

rm -r /etc/ob1/a /etc/ob1/b
dpkg --remove ob1
[ -h $enabled ] || fail "a removal has disabled ob1@a"
dpkg --purge ob1
files | grep -v '/multi-user.target.wants$' > /tmp/after
diff /tmp/before /tmp/after || fail "purged, and this is left or gone"
getent passwd ob1 && fail "the user is left"
say "all is well"
